//! Energy, force and tangent of ranges of elements, several at a time, whatever the elements are.

use std::ops::Range;

use sinew_engine::lanes::{Batch, Batches, Kernel, Lanes, MAX_LANES};
use sinew_engine::law::{EvaluationRequest, LawBuffer, Span, TangentKind};
use sinew_engine::scalar::Scalar;
use sinew_engine::schedule::Evaluation;
use sinew_engine::workers::Workers;

/// Components of one number each that laws read.
macro_rules! scalar_columns {
    ($($(#[$doc:meta])* $name:ident $(<$index:ident>)?),+ $(,)?) => {$(
        $(#[$doc])*
        #[derive(Component, Clone, Copy, Debug, Default, PartialEq, TransparentWrapper)]
        #[component(summary_tick, clone_behavior = Ignore)]
        #[repr(transparent)]
        pub struct $name<S: Scalar $(, const $index: usize)?>(pub S);
    )+};
}
pub(crate) use scalar_columns;

/// Columns of the elements of a law, with what the law makes of them. Functions are generic over the register
/// type; mark implementations `#[inline(always)]`.
pub trait LawColumns<S: Scalar>: Sync {
    /// As [`Kernel::WIDE`].
    const WIDE: bool = true;
    /// Whether the lanes of a register are the Gauss points of one element, not one element each.
    const LANES_ARE_POINTS: bool = false;
    /// Adds the energy (J) of the elements from `first` on, lane by lane.
    fn add_energy<L: Lanes<Scalar = S>>(&self, first: usize, sums: &mut [f64; MAX_LANES]);
    /// Adds their forces (N); the second number is the vertex row of the first force. There are none where other
    /// systems turn tensions into forces.
    #[inline(always)]
    fn add_forces<L: Lanes<Scalar = S>>(&self, _: usize, _: &mut [[S; 4]], _: usize) {}
    /// Adds their tangents (N/m).
    fn add_tangent<L: Lanes<Scalar = S>>(&self, first: usize, to: &mut TangentSum<S>);
}

/// Nanoseconds per element, roughly, from those of energy, force and tangent.
pub fn work(request: &EvaluationRequest, [energy, force, tangent]: [usize; 3]) -> usize {
    energy * usize::from(request.energy)
        + force * usize::from(request.force)
        + tangent * usize::from(request.tangent.is_some())
}

/// Energy, force and tangent of every range into its private arrays, as far as they are asked for; `work` is
/// that of all elements (ns). Silent for bodies that recover: the corotational energy that stands in for
/// their material has one minimum only as long as nothing is added to it.
pub fn evaluate<S: Scalar, C: LawColumns<S>>(
    columns: &C,
    Evaluation { request, workers, recovering, .. }: Evaluation,
    work: usize,
    buffer: &mut LawBuffer<S>,
) {
    buffer.for_each_awake(workers, work, |_, span| {
        if recovering.contains(span.body) {
            span.silence();
        } else {
            evaluate_span(columns, request, workers, span);
        }
    });
}

/// Energy, force and tangent of one range, as far as they are asked for.
pub fn evaluate_span<S: Scalar, C: LawColumns<S>>(
    columns: &C,
    request: &EvaluationRequest,
    workers: &Workers,
    span: &mut Span<S>,
) {
    let elements = span.elements.clone();
    if request.energy {
        let batch = EnergyBatch { columns, sums: [0.0; MAX_LANES] };
        span.energy = sum(run::<S, C, _>(workers, elements.clone(), batch).sums);
    }
    if request.force {
        span.clear_force();
        let (row, force) = (span.rows.start, &mut span.force[..]);
        run::<S, C, _>(workers, elements.clone(), ForceBatch { columns, force, row });
    }
    match request.tangent {
        Some(kind) => {
            span.clear_tangent();
            let to = TangentSum { span, kind, clamped: [0.0; MAX_LANES] };
            let to = run::<S, C, _>(workers, elements, TangentBatch { columns, to }).to;
            to.span.clamped = sum(to.clamped) as u64;
        }
        None => span.drop_tangent(),
    }
}

fn run<S: Scalar, C: LawColumns<S>, B: Batch<S>>(
    workers: &Workers,
    elements: Range<usize>,
    batch: B,
) -> B {
    if C::LANES_ARE_POINTS {
        workers.dispatch(OneByOne(elements, batch))
    } else {
        workers.dispatch(Batches(elements, batch))
    }
}

/// The kernel that carries out a batch for one element after the other, each with whole registers.
struct OneByOne<B>(Range<usize>, B);

impl<S: Scalar, B: Batch<S>> Kernel<S> for OneByOne<B> {
    type Output = B;
    const WIDE: bool = B::WIDE;
    #[inline(always)]
    fn run<L: Lanes<Scalar = S>>(self) -> B {
        let Self(elements, mut batch) = self;
        for element in elements {
            batch.batch::<L>(element);
        }
        batch
    }
}

struct EnergyBatch<'a, C> {
    columns: &'a C,
    sums: [f64; MAX_LANES],
}

impl<S: Scalar, C: LawColumns<S>> Batch<S> for EnergyBatch<'_, C> {
    const WIDE: bool = C::WIDE;
    #[inline(always)]
    fn batch<L: Lanes<Scalar = S>>(&mut self, first: usize) {
        self.columns.add_energy::<L>(first, &mut self.sums);
    }
}

struct ForceBatch<'a, S, C> {
    columns: &'a C,
    force: &'a mut [[S; 4]],
    /// Vertex row of the first entry of `force`.
    row: usize,
}

impl<S: Scalar, C: LawColumns<S>> Batch<S> for ForceBatch<'_, S, C> {
    const WIDE: bool = C::WIDE;
    #[inline(always)]
    fn batch<L: Lanes<Scalar = S>>(&mut self, first: usize) {
        self.columns.add_forces::<L>(first, self.force, self.row);
    }
}

/// Sum of the tangents of a range.
pub struct TangentSum<'a, S> {
    /// The range with its arrays.
    pub span: &'a mut Span<S>,
    /// What is asked for.
    pub kind: TangentKind,
    /// Numbers of elements whose eigenvalues were clamped, lane by lane.
    pub clamped: [f64; MAX_LANES],
}

impl<S: Scalar> TangentSum<'_, S> {
    /// Counts elements whose eigenvalues were clamped.
    #[inline(always)]
    pub fn count_clamped<L: Lanes<Scalar = S>>(&mut self, clamped: L::Mask) {
        L::select(clamped, L::ONE, L::ZERO).accumulate(&mut self.clamped);
    }
}

struct TangentBatch<'a, S, C> {
    columns: &'a C,
    to: TangentSum<'a, S>,
}

impl<S: Scalar, C: LawColumns<S>> Batch<S> for TangentBatch<'_, S, C> {
    const WIDE: bool = C::WIDE;
    #[inline(always)]
    fn batch<L: Lanes<Scalar = S>>(&mut self, first: usize) {
        self.columns.add_tangent::<L>(first, &mut self.to);
    }
}

/// Sum of the lanes, in order.
pub(crate) fn sum(sums: [f64; MAX_LANES]) -> f64 {
    sums.iter().sum()
}

/// Rows of all vertices of the elements at the start of `nodes`.
#[inline(always)]
pub fn load_vertices<L: Lanes, const V: usize>(
    rows: &[[L::Scalar; 4]],
    nodes: &[[u32; V]],
) -> [[L; 3]; V] {
    let mut values = [[L::ZERO; 3]; V];
    for a in 0..V {
        values[a] = L::load_rows(rows, nodes, a);
    }
    values
}

/// Adds to the rows of all vertices of the elements at the start of `nodes`; `row` is that of the first entry
/// of `to`.
#[inline(always)]
pub fn add_vertices<L: Lanes, const V: usize>(
    values: [[L; 3]; V],
    to: &mut [[L::Scalar; 4]],
    row: usize,
    nodes: &[[u32; V]],
) {
    for a in 0..V {
        L::add_rows(values[a], to, row, nodes, a);
    }
}

/// Columns of a law whose tangent can be multiplied without assembly.
pub trait LawProducts<S: Scalar, const V: usize>: Sync {
    /// As [`Kernel::WIDE`].
    const WIDE: bool;
    /// Vertex rows of all elements.
    fn nodes(&self) -> &[[u32; V]];
    /// Products (N) of the tangents of the elements from `first` on with the displacements `v` (m).
    fn products<L: Lanes<Scalar = S>>(
        &self,
        first: usize,
        kind: TangentKind,
        v: &[[L; 3]; V],
    ) -> [[L; 3]; V];
}

/// Adds the product `K v` of a law's tangent to `result`, `work` (ns) being that of one element. Uses the
/// private force arrays of `buffer`.
pub fn multiply<S: Scalar, C: LawProducts<S, V>, const V: usize>(
    columns: &C,
    kind: TangentKind,
    direction: &[[S; 4]],
    workers: &Workers,
    work: usize,
    buffer: &mut LawBuffer<S>,
    result: &mut [[S; 4]],
) {
    workers.for_each(&mut buffer.spans, columns.nodes().len() * work, |_, span| {
        span.clear_force();
        let (force, row) = (&mut span.force[..], span.rows.start);
        let batch = ProductBatch { columns, direction, kind, force, row };
        workers.dispatch(Batches(span.elements.clone(), batch));
    });
    buffer.add_forces_to(workers, result);
}

struct ProductBatch<'a, S, C, const V: usize> {
    columns: &'a C,
    direction: &'a [[S; 4]],
    kind: TangentKind,
    force: &'a mut [[S; 4]],
    /// Vertex row of the first entry of `force`.
    row: usize,
}

impl<S: Scalar, C: LawProducts<S, V>, const V: usize> Batch<S> for ProductBatch<'_, S, C, V> {
    const WIDE: bool = C::WIDE;
    #[inline(always)]
    fn batch<L: Lanes<Scalar = S>>(&mut self, first: usize) {
        let nodes = &self.columns.nodes()[first..];
        let v = load_vertices::<L, V>(self.direction, nodes);
        let product = self.columns.products(first, self.kind, &v);
        add_vertices(product, self.force, self.row, nodes);
    }
}
