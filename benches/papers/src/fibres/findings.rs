//! What is found of the block, and when a finding holds.

use super::*;

/// How far the place of the bottom scatters about its mean over meshes, in the root mean square and over the elongation;
/// not a number where a mesh did not come to rest.
pub(super) fn scatter(shapes: &[Option<Shape>]) -> f64 {
    let known: Vec<Shape> = shapes.iter().flatten().copied().collect();
    let count = known.len() as f64;
    if known.len() < shapes.len() || known.len() < 2 {
        return f64::NAN;
    }
    let mean = known.iter().map(|s| s.bottom).sum::<DVec3>() / count;
    let squares: f64 = known.iter().map(|s| s.bottom.distance_squared(mean)).sum();
    (squares / (count - 1.0)).sqrt() / -mean.z
}

/// Largest difference of the place of the bottom between meshes, over the elongation; not a number where a mesh
/// did not come to rest.
fn parting(shapes: &[Option<Shape>]) -> f64 {
    let mut worst: f64 = 0.0;
    for a in shapes {
        for b in shapes {
            let (Some(a), Some(b)) = (a, b) else { return f64::NAN };
            worst = worst.max(a.bottom.distance(b.bottom) / a.stretch());
        }
    }
    worst
}

/// Mean and standard deviation of draws.
pub(super) fn statistics(values: &[f64]) -> [f64; 2] {
    let count = values.len() as f64;
    let mean = values.iter().sum::<f64>() / count;
    let squares: f64 = values.iter().map(|x| (x - mean).powi(2)).sum();
    [mean, (squares / (count - 1.0)).sqrt()]
}

/// Share of the elongation by which the bottom may leave the vertical and is said to hardly do so.
const HARDLY: f64 = 0.01;
/// Share by which it leaves it for all to see.
const VISIBLE: f64 = 0.2;
/// Share by which meshes may differ.
const SAME: f64 = 0.03;
/// Share within which meshes are called near each other, where they must come nearer on finer ones.
const NEAR: f64 = 0.1;

impl Measured {
    pub(super) fn of(&self, size: usize, mesh: usize, what: What) -> Option<&Swing> {
        self.runs.iter().find(|r| r.0 == Key::of(size, mesh, what)).map(|r| &r.1)
    }

    fn end(&self, size: usize, mesh: usize, what: What) -> Option<Shape> {
        self.of(size, mesh, what)?.end
    }

    /// Not a number where the run did not come to rest.
    fn drift(&self, size: usize, mesh: usize, what: What) -> f64 {
        self.end(size, mesh, what).map_or(f64::NAN, |s| s.drift())
    }

    /// Figure 6, on the first irregular mesh and with springs of volume.
    pub(super) fn figure_6(&self, field: Field) -> Option<&Swing> {
        self.of(0, IRREGULAR[0], What::Printed { field, volume: 1 })
    }

    /// The same pulled by another traction (Pa).
    fn pulled_by(&self, traction: f64, field: Field) -> Option<&Swing> {
        let what = What::Printed { field, volume: 1 };
        let key = Key { traction, ..Key::of(0, IRREGULAR[0], what) };
        self.runs.iter().find(|r| r.0 == key).map(|r| &r.1)
    }

    pub(super) fn findings(&self) -> Vec<Finding> {
        let mut findings = self.of_anisotropy().to_vec();
        findings.extend(self.of_courses());
        findings.extend(self.of_motion());
        findings.extend([Field::None, Field::Horizontal].map(|field| self.of_straight(field)));
        findings.extend(self.of_tilings());
        findings.extend(self.of_hexahedra());
        findings
    }

    /// Figures 1 and 5.
    fn of_anisotropy(&self) -> [Finding; 2] {
        let on = |volume| What::Printed { field: Field::None, volume };
        let [off, with] = [0, 1].map(|volume| self.drift(0, PARALLEL, on(volume)));
        let springs = self.drift(0, PARALLEL, What::Springs);
        let energy = self.drift(0, PARALLEL, What::Energy { field: Field::None, volume: 0 });
        let text = format!(
            "on tetrahedra cut by parallel diagonals plain springs, as stiff as the material under a small load, leave the \
             vertical by {:.0} % of the elongation (at least {:.0} % is seen by all), axes as printed hardly ({:.0} % \
             allowed): {:.1} % without springs of volume, {:.1} % with them, {:.1} % in the form with an energy",
            100.0 * springs,
            100.0 * VISIBLE,
            100.0 * HARDLY,
            100.0 * off,
            100.0 * with,
            100.0 * energy
        );
        let met = [off, with].map(|axes| axes < HARDLY && springs > VISIBLE);
        let parallel = match met {
            [true, true] => Finding::of(true),
            [off, on] => Finding::not_determined(
                off || on,
                format!(
                    "springs of volume, which the paper names with its figure 3 only: it holds {}",
                    match (off, on) {
                        (true, _) => "without them, not with them",
                        (_, true) => "with them, not without",
                        _ => "neither without nor with them",
                    }
                ),
            ),
        };
        let mean = |size: usize| {
            let all = IRREGULAR.map(|mesh| self.drift(size, mesh, What::Springs));
            all.iter().sum::<f64>() / all.len() as f64
        };
        let (coarse, fine) = (mean(0), mean(1));
        let random = Finding::of(coarse < 0.5 * springs && fine < coarse).says(format!(
            "the undesired anisotropy of plain springs tends to disappear on random meshes as they become denser: mean \
             sideways motion of {:.1} % of the elongation with {} cells (at most half of the {:.0} % on parallel cuts) and \
             {:.1} % with {} (less)",
            100.0 * coarse,
            CELLS.iter().product::<usize>(),
            100.0 * springs,
            100.0 * fine,
            FINE.iter().product::<usize>()
        ));
        [parallel.says(text), random]
    }

    /// Shapes of random fibres at rest.
    fn draws(&self, size: usize, volume: u32, of: fn(&Shape) -> f64) -> Vec<f64> {
        (1..=DRAWS[size])
            .map(|draw| {
                let what = What::Printed { field: Field::Random(draw), volume };
                self.end(size, mesh_of(draw), what).map_or(f64::NAN, |s| of(&s))
            })
            .collect()
    }

    /// Figure 6 a: whether the block is thinner and longer than with random fibres, beyond what chance does to these.
    fn of_horizontal(&self) -> Finding {
        let missing = [f64::NAN; 4];
        let seen = |s: Shape| [s.stretch(), s.section(), s.width[0], s.width[1]];
        let plain = self.figure_6(Field::None).and_then(|s| s.end).map_or(missing, seen);
        let horizontal = |volume| {
            let what = What::Printed { field: Field::Horizontal, volume };
            self.end(0, IRREGULAR[0], what).map_or(missing, seen)
        };
        let mut words = Vec::new();
        let met = FACTORS.map(|volume| {
            let level = horizontal(volume);
            let [longer, section] =
                [Shape::stretch, Shape::section].map(|of| statistics(&self.draws(0, volume, of)));
            words.push(format!(
                "{volume}: {:.1} mm beside {:.1} +- {:.1} mm, {:.1} % beside {:.1} +- {:.1} % ({:.1} % of the width along the \
                 fibres, {:.1} % across them)",
                1e3 * level[0],
                1e3 * longer[0],
                1e3 * longer[1],
                100.0 * level[1],
                100.0 * section[0],
                100.0 * section[1],
                100.0 * level[2],
                100.0 * level[3],
            ));
            level[0] > longer[0] + 2.0 * longer[1] && level[1] < section[0] - 2.0 * section[1]
        });
        let where_met: Vec<String> =
            FACTORS.iter().zip(met).filter(|m| m.1).map(|m| m.0.to_string()).collect();
        let finding = match where_met.len() {
            n if n == FACTORS.len() => Finding::of(true),
            0 => Finding::not_determined(
                false,
                "constants of volume springs of 1 to 10 times the moduli's",
            ),
            _ => Finding::not_determined(
                true,
                format!(
                    "the constant of volume springs, which is not printed: a block that is longer is thinner where volume is \
                     kept; it holds at {} times what the moduli ask for",
                    where_met.join(" and ")
                ),
            ),
        };
        finding.says(format!(
            "horizontal fibres make the block thinner and longer than random ones, the paper's isotropic body, by more than \
             twice what chance scatters ({} draws). Elongation and cross-section of the middle over that at rest, by the \
             constant of volume springs over what the moduli ask for: {}. Without fibres {:.1} mm and {:.1} %; without \
             springs of volume no block thins ({:.1} %), so this figure needs them",
            DRAWS[0],
            words.join("; "),
            1e3 * plain[0],
            100.0 * plain[1],
            100.0 * horizontal(0)[1],
        ))
    }

    /// Figure 6 at rest.
    fn of_courses(&self) -> [Finding; 4] {
        let horizontal = self.of_horizontal();
        let diagonal = What::Printed { field: Field::Diagonal, volume: 1 };
        let diagonal = self.drift(0, IRREGULAR[0], diagonal);
        let bend = Finding::of(diagonal > VISIBLE).says(format!(
            "diagonal fibres bend the block to one side: sideways motion of {:.0} % of the elongation (at least {:.0} %)",
            100.0 * diagonal,
            100.0 * VISIBLE
        ));
        let drifts = [0, 1].map(|size| self.draws(size, 1, Shape::drift));
        let [coarse, fine] = [0, 1].map(|size| statistics(&drifts[size])[0]);
        let most = drifts[0].iter().fold(0.0f64, |m, x| m.max(*x));
        let isotropic = Finding::of(coarse < NEAR && NEAR < diagonal).says(format!(
            "random fibres leave the block isotropic: over {} draws its sideways motion is {:.1} % of the elongation on \
             average and {:.1} % at most ({:.0} % allowed on average), beside {:.0} % with diagonal fibres",
            DRAWS[0],
            100.0 * coarse,
            100.0 * most,
            100.0 * NEAR,
            100.0 * diagonal
        ));
        // chance falls as the root of the number of elements. Lengths of two random numbers scatter by sqrt(4/pi - 1) = 0.52
        // of their mean, so that the ratio of two means is known to that much over the roots of their counts
        let root = 8.0_f64.sqrt().recip();
        let error = 0.52 * DRAWS.map(|n| (n as f64).recip()).iter().sum::<f64>().sqrt();
        let allowed = root * (1.0 + 2.0 * error);
        let falls = Finding::of(fine < allowed * coarse).says(format!(
            "what is left is chance and falls with the number of elements: with eight times as many {:.2} of it is left, \
             {:.2} % of the elongation ({} draws, on {} meshes in turn; {root:.2} as the inverse \
             root, up to {allowed:.2} by twice the standard error of such means)",
            fine / coarse,
            100.0 * fine,
            DRAWS[1],
            SEEDS.len(),
        ));
        [horizontal, bend, isotropic, falls]
    }

    /// Figure 6 in motion.
    fn of_motion(&self) -> [Finding; 2] {
        let twists = self.figure_6(Field::Helicoidal).map(Swing::twists).unwrap_or_default();
        let largest = |field| {
            let twist = |s: &Swing| s.shapes.iter().fold(0.0f64, |m, s| m.max(s.twist.abs()));
            self.figure_6(field).map_or(f64::NAN, twist)
        };
        let (own, without) = (largest(Field::Helicoidal), largest(Field::None));
        let list: Vec<String> = twists.iter().map(|t| format!("{t:.1}")).collect();
        // from 0 out, back and out again
        let successively = twists.len() >= 4 && without < CLEAR * own;
        let helix = Finding::of(successively).says(format!(
            "helicoidal fibres twist and untwist it successively: its bottom turns to {} degrees within {:.1} s; \
             without fibres it turns by {without:.2} degrees at most",
            list.join(", "),
            STEP * SWING as f64
        ));
        [helix, self.of_snake()]
    }

    /// Figure 6 c: whether the middle goes to both sides in turn, which diagonal fibres do not make it do.
    fn of_snake(&self) -> Finding {
        let undulation = |traction, field| {
            self.pulled_by(traction, field).map_or(f64::NAN, |s| 100.0 * s.undulation())
        };
        let both = TRACTIONS.map(|traction| {
            [Field::Hemicircular, Field::Diagonal].map(|field| undulation(traction, field))
        });
        let clear = 100.0 * CLEAR;
        let met = both.map(|[own, other]| own > clear && other < clear);
        let over = |i: usize| format!("{:.2}", TRACTIONS[i] / MATERIAL.young_modulus);
        let words: Vec<String> = both
            .iter()
            .enumerate()
            .map(|(i, [own, other])| format!("{own:.0} and {other:.0} % at {}", over(i)))
            .collect();
        let holds: Vec<String> = (0..met.len()).filter(|i| met[*i]).map(over).collect();
        let finding = match holds.len() {
            n if n == met.len() => Finding::of(true),
            0 => Finding::not_determined(false, "loads of 0.05 to 0.3 E"),
            _ => Finding::not_determined(
                true,
                format!(
                    "the load over Young's modulus, which is not printed: it holds at {}",
                    holds.join(", ")
                ),
            ),
        };
        finding.says(format!(
            "hemicircular fibres make it undulate like a snake: its middle goes to both sides in turn, to the lesser one by \
             at least {clear:.0} % of the way to the other, with diagonal fibres by less; with either by {}",
            words.join(", ")
        ))
    }

    /// Where the bottom comes to rest on some meshes.
    fn ends(&self, size: usize, meshes: &[usize], what: What) -> Vec<Option<Shape>> {
        meshes.iter().map(|mesh| self.end(size, *mesh, what)).collect()
    }

    /// How far all meshes of tetrahedra part (%), coarse and fine: as printed, and in the form with an energy.
    fn partings(&self, field: Field) -> [[f64; 2]; 2] {
        let tetrahedra: Vec<usize> = std::iter::once(PARALLEL).chain(IRREGULAR).collect();
        let of = |meshes: &[usize], what| {
            [0, 1].map(|size| 100.0 * parting(&self.ends(size, meshes, what)))
        };
        let meshes = if CURVED.contains(&field) { &tetrahedra[..] } else { &FEW };
        let printed = of(meshes, What::Printed { field, volume: 0 });
        [printed, of(&FEW, What::Energy { field, volume: 0 })]
    }

    /// Whether a block that only stretches goes to the same place on all meshes.
    fn of_straight(&self, field: Field) -> Finding {
        let [[coarse, fine], [energy, fine_energy]] = self.partings(field);
        let what = match field {
            Field::None => "without fibres".to_string(),
            _ => format!("with {} fibres", field.name()),
        };
        let allowed = 100.0 * SAME;
        Finding::of(coarse < allowed && fine < allowed).says(format!(
            "{what} the bottom goes to the same place on tetrahedra cut alike or irregularly, without springs of volume: \
             within {coarse:.1} % of the elongation with {} cells and {fine:.1} % with {} ({allowed:.0} % allowed on both; \
             the form with an energy: {energy:.1} and {fine_energy:.1} %)",
            CELLS.iter().product::<usize>(),
            FINE.iter().product::<usize>()
        ))
    }

    /// Whether blocks that bend or twist do so on all meshes.
    fn of_tilings(&self) -> [Finding; 2] {
        let list = |values: [f64; 3]| values.map(|x| format!("{x:.1}")).join(", ");
        let names = CURVED.map(Field::name).join(", ");
        let irregular = |size: usize, of: fn(&[Option<Shape>]) -> f64| {
            CURVED.map(|field| {
                let what = What::Printed { field, volume: 0 };
                100.0 * of(&self.ends(size, &IRREGULAR, what))
            })
        };
        let [apart, scatters] = [parting, scatter].map(|of| [0, 1].map(|size| irregular(size, of)));
        let same = (0..CURVED.len())
            .all(|i| apart[1][i] < 100.0 * SAME && scatters[1][i] < scatters[0][i]);
        let irregular = Finding::of(same).says(format!(
            "on irregular tetrahedra alone fibres act independently of the mesh ({names}): on {} meshes the bottom goes to the \
             same place within {} % of the elongation with {} cells and {} % with {} ({:.0} % allowed on the finer ones), and \
             scatters by {} and by {} % (standard deviation, less on the finer ones)",
            IRREGULAR.len(),
            list(apart[0]),
            CELLS.iter().product::<usize>(),
            list(apart[1]),
            FINE.iter().product::<usize>(),
            100.0 * SAME,
            list(scatters[0]),
            list(scatters[1]),
        ));
        let all = CURVED.map(|field| self.partings(field));
        let moments = &self.moments;
        // visible, not smaller on finer meshes, and there only where the moment is
        let stays = |[coarse, fine]: [f64; 2]| fine > 100.0 * VISIBLE && fine > 0.7 * coarse;
        let shown = all.iter().all(|[printed, energy]| stays(*printed) && energy[1] < 100.0 * NEAR)
            && moments.off < 1e-9
            && moments.own > 0.01;
        let mean = |i: usize| moments.mean.get(i).copied().unwrap_or(f64::NAN);
        let tiling = Finding::paper_wrong(
            shown,
            format!(
                "printed forces of angles have the net moment -k m (|l1| - |l2|) u1 x u2, which is not zero unless the \
                 chords of an element are equally long (sheared tetrahedron: {:.0} % of k m (|l1| + |l2|), off that formula \
                 by {:.0e}). With k = G V/L the moment per volume does not shrink with the elements, and where they are cut \
                 alike it has one sign: the mean of (L1 - L2)/L is {:.2} and {:.2} on parallel cuts, coarse and fine, and \
                 {:.2} and {:.2} on irregular ones. The form with an energy has no moment",
                100.0 * moments.own,
                moments.off,
                mean(0),
                mean(1),
                mean(2),
                mean(3)
            ),
        )
        .says(format!(
            "what fibres do is independent of the tiling ({names}): with printed angular springs, and parallel cuts beside \
             irregular ones, the place of the bottom differs by {} % of the elongation with {} cells and by {} % with {}; \
             in the form with an energy by {} and {} %",
            list(all.map(|p| p[0][0])),
            CELLS.iter().product::<usize>(),
            list(all.map(|p| p[0][1])),
            FINE.iter().product::<usize>(),
            list(all.map(|p| p[1][0])),
            list(all.map(|p| p[1][1]))
        ));
        [irregular, tiling]
    }

    /// Whether hexahedra can be run as printed, and what they need.
    fn of_hexahedra(&self) -> [Finding; 2] {
        let runs = self.runs.iter().filter(|r| r.0.mesh == HEXAHEDRA);
        let failed: Vec<String> = runs
            .filter_map(|(key, s)| {
                Some(format!("{}: {}", key.what.field().name(), s.failed.as_ref()?))
            })
            .collect();
        let rest = Finding::of(failed.is_empty()).says(format!(
            "hexahedra with printed, damped springs come to rest: {}",
            match failed.first() {
                None => "all courses of fibres".to_string(),
                Some(first) => format!("{} runs do not, the first of them {first}", failed.len()),
            }
        ));
        let [without, with] = self.modes;
        let modes = Finding::of(without == 18 && with < without).says(format!(
            "hexahedra need the springs of volume that table 1 counts in them and figures 5 and 6 do not name: three axes \
             and three angles resist 6 of 24 motions of their vertices and leave {without} free, rigid ones included, so \
             that they have no one state of rest; with 8 radial springs {with} are left. So tetrahedra are compared here"
        ));
        [rest, modes]
    }
}
