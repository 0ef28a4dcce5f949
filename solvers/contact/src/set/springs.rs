//! Tools that a hand holds by a spring: where they are for a given state of the bodies.
//!
//! With the hand at `h` a tool of spring `K` is at `h + o`, where `K o^2 / 2` and the energy `psi(x, o)` of its contacts have
//! their lowest sum. So that sum is a potential of the places `x` of the bodies alone. Its force is that of the contacts there,
//! and its tangent is theirs, `H_i` at point `i`, less what the tool gives back:
//!
//! `sum_i B_i^T H_i B_i - (sum_i B_i^T H_i) (K + sum_i H_i)^-1 (sum_i H_i B_i)`.
//!
//! Solvers need no unknowns for the tool, and whatever holds for potentials of contact holds for it: energy does not rise while
//! the hand rests.

use super::*;

/// Force that is left out of balance over the forces on a tool, at which it counts as balanced.
const BALANCED: f64 = 1e-10;
/// The same above which a step that ends so has not converged.
const UNBALANCED: f64 = 1e-6;
/// Most iterations, and halvings of one.
const MOST: [u32; 2] = [40, 30];

/// A tool of a spring in this step.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct SpringNow {
    /// Way (m) from the hand to the tool at the start of the step.
    pub begin: DVec3,
    /// The same at the start of what is left of the step, in substeps.
    pub from: DVec3,
    /// The same now.
    pub now: DVec3,
    /// Force (N) out of balance over those that act, at the last evaluation.
    pub left: f64,
}

/// What a tool gives back to the bodies that it touches: a vector `v` (N/m)^(1/2) of rows, ascending, that takes `v v^T` off
/// the matrix.
#[derive(Clone, Debug, Default)]
pub struct GivenBack {
    /// The tool, by its place in the step.
    pub tool: usize,
    /// Rows, and what `v` has there.
    pub rows: Vec<(u32, DVec3)>,
}

impl SpringNow {
    /// Way (m) of the tool beside that of its hand.
    pub fn way(&self) -> DVec3 {
        self.now - self.from
    }
}

impl ContactSet {
    /// Tools that a spring holds, with its stiffness (N/m).
    fn sprung(&self) -> impl Iterator<Item = (usize, f64)> + '_ {
        let of = |(i, now): (usize, &ToolNow)| now.tool.spring.map(|stiffness| (i, stiffness));
        self.tools.iter().enumerate().filter_map(of)
    }

    /// Energy (J) of the springs of tools.
    pub(super) fn spring_energy(&self) -> f64 {
        let of = |(i, k): (usize, f64)| 0.5 * k * self.tools[i].spring.now.length_squared();
        self.sprung().map(of).sum()
    }

    /// The points of a range that a tool may touch, or that hold its edge or needle.
    fn points_of(&self, tool: usize, range: &Range<usize>) -> Vec<usize> {
        let is_own = |i: &usize| self.is_of_tool(&self.points[*i], tool);
        range.clone().filter(is_own).collect()
    }

    /// Whether it is one that a tool may touch, or that holds its edge or needle.
    pub(super) fn is_of_tool(&self, point: &ContactPoint, tool: usize) -> bool {
        match &point.against {
            Against::Part(part) => self.tools[tool].parts.contains(part),
            Against::Edge(edge) => edge.tool == tool,
            Against::Needle(own) => own.tool == tool,
            Against::Hand(_) | Against::Faces(_) => false,
        }
    }

    /// The bodies of the points of every tool on a spring.
    pub(super) fn joined_by_springs(&self) -> Vec<Range<usize>> {
        let of = |(tool, _): (usize, f64)| {
            let own = self.points_of(tool, &(0..self.points.len()));
            let bodies = own.iter().map(|&i| self.points[i].key.body as usize);
            Some(bodies.clone().min()?..bodies.max()? + 1)
        };
        self.sprung().filter_map(of).collect()
    }

    /// Tools that nothing is near are where their hands are.
    pub(super) fn let_go(&mut self) {
        let all = 0..self.points.len();
        let free = self.sprung().map(|(tool, _)| tool);
        let free: Vec<usize> = free.filter(|&t| self.points_of(t, &all).is_empty()).collect();
        for tool in free {
            self.move_tool(tool, &[], DVec3::ZERO);
        }
    }

    /// Puts a tool `offset` (m) from its hand, with its points.
    fn move_tool(&mut self, tool: usize, points: &[usize], offset: DVec3) {
        let own = &mut self.tools[tool];
        let by = offset - std::mem::replace(&mut own.spring.now, offset);
        for part in &mut self.parts[own.parts.clone()] {
            part.now.centre += by;
        }
        for &i in points {
            match &mut self.points[i].against {
                Against::Needle(own) => own.now.centre += by,
                _ => self.points[i].carried += by,
            }
        }
    }

    /// Puts tools on springs where they are in balance with the points of a range at positions `x`, with the limits of friction as they
    /// are; the energy (J) of their springs.
    pub(super) fn balance(&mut self, range: &Range<usize>, x: &RowPlaces) -> f64 {
        let sprung: Vec<(usize, f64)> = self.sprung().collect();
        let mut sum = 0.0;
        for (tool, k) in sprung {
            let points = self.points_of(tool, range);
            if !points.is_empty() {
                self.balance_tool((tool, k), &points, x);
                sum += 0.5 * k * self.tools[tool].spring.now.length_squared();
            }
        }
        sum
    }

    fn balance_tool(&mut self, (tool, k): (usize, f64), points: &[usize], x: &RowPlaces) {
        let mut o = self.tools[tool].spring.now;
        let mut at = self.at_offset((tool, k), points, x, o);
        let mut may_be_free = true;
        for _ in 0..MOST[0] {
            if at.forces == 0.0 && may_be_free {
                // nothing holds it back: exactly where the hand is, if nothing touches it there either
                (o, may_be_free) = (DVec3::ZERO, false);
                at = self.at_offset((tool, k), points, x, o);
            }
            if at.left(k * o) <= BALANCED {
                break;
            }
            let step = -(at.tangent.inverse() * at.slope);
            if !step.is_finite() {
                break;
            }
            let mut found = None;
            for halving in 0..MOST[1] {
                let tried = o + 0.5_f64.powi(halving as i32) * step;
                let new = self.at_offset((tool, k), points, x, tried);
                // rounding hides what is won where the slope is small
                if new.energy < at.energy || new.slope.length() < 0.5 * at.slope.length() {
                    found = Some((tried, new));
                    break;
                }
            }
            let Some((tried, new)) = found else { break };
            (o, at) = (tried, new);
        }
        self.tools[tool].spring.left = at.left(k * o);
        self.move_tool(tool, points, o);
    }

    /// Energy of a tool and its spring where it is `o` (m) from its hand.
    fn at_offset(
        &mut self,
        (tool, k): (usize, f64),
        points: &[usize],
        x: &RowPlaces,
        o: DVec3,
    ) -> AtOffset {
        self.move_tool(tool, points, o);
        let (parts, made) = (&self.parts, &self.made);
        let now = |row: VertexRow| made.mean(row, x.now);
        let start = |row: VertexRow| made.mean(row, x.start);
        let mut sum = AtOffset {
            energy: 0.5 * k * o.length_squared(),
            slope: k * o,
            tangent: DMat3::from_diagonal(DVec3::splat(k)),
            forces: 0.0,
            rounding: 0.0,
        };
        for &i in points {
            let active = self.points[i].evaluate(parts, None, &now, &start, Limits::Keep);
            let force = active.push + active.rub;
            sum.energy += active.energy;
            sum.slope += force;
            sum.tangent += active.block;
            sum.forces += force.length();
        }
        let trace = sum.tangent.x_axis.x + sum.tangent.y_axis.y + sum.tangent.z_axis.z;
        let place = self.tools[tool].end.position.length() + o.length();
        sum.rounding = ROUNDINGS * f64::EPSILON * trace * place;
        sum
    }

    /// Whether some tool on a spring is not in balance.
    pub(super) fn is_unbalanced(&self) -> bool {
        let left = |(tool, _): (usize, f64)| self.tools[tool].spring.left;
        self.sprung().map(left).any(|left| left > UNBALANCED || left.is_nan())
    }

    /// Blocks that the contacts of some bodies add to the matrix ([`Self::blocks`]) where a tool stays where it is, though a spring holds it.
    pub fn blocks_with_held(&self, bodies: &Range<usize>, tool: Entity) -> ContactBlocks {
        let mut blocks = self.blocks(bodies);
        blocks.given.retain(|own| self.tools[own.tool].entity != tool);
        blocks
    }

    /// Where a tool is that acted in a step, by its order: the tool itself, not the hand that holds it by a spring.
    pub fn pose_of_tool(&self, tool: Order) -> Option<ToolPose> {
        Some(self.kept.tools.get(&tool)?.of_tool())
    }

    /// The bodies, solved for together, that touched a tool at the last evaluation; none where none did.
    pub fn group_at(&self, tool: Entity, bodies: usize) -> Option<Range<usize>> {
        let index = self.tools.iter().position(|now| now.entity == tool)?;
        let mut both = self.points.iter().zip(&self.active);
        let (point, _) = both.find(|(point, active)| active.on && self.is_of_tool(point, index))?;
        let body = point.key.body as usize;
        self.groups(bodies).into_iter().find(|group| group.contains(&body))
    }

    /// Unit vector in which tissue pushes a tool at the last evaluation, where it pushes to one side and nothing is gripped or cut.
    pub fn push_on(&self, tool: Entity) -> Option<DVec3> {
        let index = self.tools.iter().position(|now| now.entity == tool)?;
        let (mut sum, mut all) = (DVec3::ZERO, 0.0);
        for active in self.touching(index) {
            sum -= active.push;
            all += active.push.length();
        }
        let own = &self.tools[index].tool;
        let is_one =
            !own.grip && own.edge.is_none() && own.needle.is_none() && sum.length() > 0.5 * all;
        sum.try_normalize().filter(|_| is_one)
    }

    /// What tools on springs give back to some bodies, at the last evaluation.
    pub(super) fn given_back(&self, bodies: &Range<usize>) -> Vec<GivenBack> {
        let range = self.range(bodies);
        let mut all = Vec::new();
        for (tool, k) in self.sprung() {
            let points = self.points_of(tool, &range);
            let on = || points.iter().map(|&i| &self.active[i]).filter(|active| active.on);
            let sum = on().map(|active| active.block).sum::<DMat3>();
            if sum == DMat3::ZERO {
                continue;
            }
            let tangent = sum + DMat3::from_diagonal(DVec3::splat(k));
            for root in root(tangent.inverse()) {
                let shares = |active: &Active| {
                    let force = active.block * root;
                    let used = self.made.expand(active.rows, active.weights);
                    used.map(|(row, weight)| (row.0, weight * force)).collect::<Vec<_>>()
                };
                let mut rows: Vec<(u32, DVec3)> = on().flat_map(shares).collect();
                sum_by_row(&mut rows);
                all.push(GivenBack { tool, rows });
            }
        }
        all
    }
}

/// Energy (J), its derivatives by the offset, the sum of the magnitudes of forces (N), and what rounding of places does to the slope (N).
struct AtOffset {
    energy: f64,
    slope: DVec3,
    tangent: DMat3,
    forces: f64,
    rounding: f64,
}

impl AtOffset {
    /// Force out of balance, beyond rounding, over those that act, where that of the spring is so large (N).
    fn left(&self, spring: DVec3) -> f64 {
        let left = self.slope.length();
        if left <= self.rounding {
            return 0.0;
        }
        left / (self.forces + spring.length()).max(f64::MIN_POSITIVE)
    }
}

/// Columns `l` with `sum l l^T` that matrix, which is symmetric and positive definite (Cholesky).
fn root(m: DMat3) -> [DVec3; 3] {
    let mut left = m;
    [0, 1, 2].map(|i| {
        let pivot = left.col(i)[i];
        if pivot.is_nan() || pivot <= 0.0 {
            return DVec3::ZERO;
        }
        let column = left.col(i) / pivot.sqrt();
        left -= outer(column, column);
        column
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn columns_of_a_root_give_the_matrix_back() {
        let a = DMat3::from_cols_array(&[2.0, 0.3, -0.4, 0.3, 1.5, 0.2, -0.4, 0.2, 0.7]);
        let sum = root(a).into_iter().map(|own| outer(own, own)).sum::<DMat3>();
        assert!(sum.abs_diff_eq(a, 1e-15), "{sum}");
    }
}
