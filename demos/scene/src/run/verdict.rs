//! Why a run that came to its end is not to be trusted.

use super::totals::Totals;
use crate::assemble::{BuiltBody, BuiltScene};
use crate::text::short;
use sinew::engine::connectivity::ElementKind;
use sinew::models::body::Model;

/// Part of the steps above which a run whose bodies were halted, or whose iteration did not converge, counts as failed, and
/// how many there must be.
const HALTED: (f64, u64) = (0.25, 5);
/// Energy from nowhere, over all that was put in, above which a run counts as failed.
const GAIN: f64 = 0.1;
/// Part of the elements that may be inside out at the end: recovery takes a body with more of them for out of shape.
const INSIDE_OUT: f64 = 0.05;
/// Part of the elements that may be inside out at any time: with most of them the motion is no longer that of the body.
const EVER_INSIDE_OUT: f64 = 0.5;
/// Elastic energy over that of a strain of one everywhere (the modulus of waves, lambda + 2 mu, times the volume), above
/// which no tissue is whole: bodies are then stretched to three or four times their length throughout.
const HELD: f64 = 10.0;

/// What is wrong with it, and what to do; `None` for a run to be trusted as far as it tells.
pub(super) fn untrue(built: &BuiltScene, totals: &Totals) -> Option<String> {
    halted(totals)
        .or_else(|| unconverged(built, totals))
        .or_else(|| inside_out(built, totals))
        .or_else(|| beyond_hold(built, totals))
        .or_else(|| gain(built, totals))
}

fn often(count: u64, steps: u64) -> bool {
    count >= HALTED.1 && count as f64 > HALTED.0 * steps as f64
}

fn halted(totals: &Totals) -> Option<String> {
    let (steps, halted) = (totals.step_times.count(), totals.solver.halted_steps);
    often(halted, steps).then(|| {
        format!(
            "in {halted} of {steps} steps a body was halted because no state of lower energy was found, so it \
             hardly moved; loads, motions or units are far beyond what the material holds: make them smaller, \
             or use a smaller dt"
        )
    })
}

fn unconverged(built: &BuiltScene, totals: &Totals) -> Option<String> {
    let integrator = built.plan.settings.integrator;
    let (steps, count) = (totals.step_times.count(), totals.solver.unconverged_steps);
    (integrator.converges() && often(count, steps)).then(|| {
        format!(
            "integrator {} did not converge in {count} of {steps} steps; use a smaller dt, or integrator = \"safe\"",
            integrator.name()
        )
    })
}

fn inside_out(built: &BuiltScene, totals: &Totals) -> Option<String> {
    let elements: usize = built.bodies.iter().map(solid_elements).sum();
    let volume = &totals.volume;
    let over = |count: u64, part: f64| count as f64 > part * elements as f64;
    let remedy = "loads, motions or units are beyond what the material holds: make them smaller or slower";
    if over(volume.inverted_final, INSIDE_OUT) {
        let count = volume.inverted_final;
        return Some(format!("{count} of {elements} elements are inside out at the end; {remedy}"));
    }
    over(volume.inverted_max, EVER_INSIDE_OUT).then(|| {
        format!("{} of {elements} elements were inside out; {remedy}", volume.inverted_max)
    })
}

fn solid_elements(body: &BuiltBody) -> usize {
    body.element_count(ElementKind::Tetrahedron) + body.element_count(ElementKind::Hexahedron)
}

fn beyond_hold(built: &BuiltScene, totals: &Totals) -> Option<String> {
    let held: f64 = built.bodies.iter().map(|body| held_energy(body)).sum::<Option<f64>>()?;
    let most = totals.energy.elastic_max;
    (most > HELD * held).then(|| {
        format!(
            "the bodies stored up to {} J, {} times what a strain of one everywhere takes; no tissue holds that: make loads \
             and motions smaller, and check their units",
            short(most),
            short(most / held)
        )
    })
}

/// Energy (J) of a body at a strain of one; `None` where constants of springs that are no material decide it.
fn held_energy(body: &BuiltBody) -> Option<f64> {
    let mut held = 0.0;
    if body.mesh.is_solid() {
        if body.model == Model::MassSpring {
            return None;
        }
        let waves = body.material.lame().ok().map(|l| l.lambda + 2.0 * l.mu)?;
        let axes = body.axes.as_ref().map_or(0.0, |axes| {
            let families = axes.families.iter();
            let active = |f: &sinew::models::axes::description::AxisFamily| {
                f.modulus + f.muscle.as_ref().map_or(0.0, |m| m.peak_stress)
            };
            families.map(active).sum::<f64>() + axes.volume_modulus
        });
        held += (waves + axes) * body.report.statistics.total_volume;
    }
    if let Some(membrane) = &body.membrane {
        held += membrane.settings.material.young_modulus * membrane.settings.thickness * membrane.area;
    }
    Some(held)
}

fn gain(built: &BuiltScene, totals: &Totals) -> Option<String> {
    if !built.plan.settings.integrator.facts().dynamic {
        return None;
    }
    let gain = -totals.dissipated();
    let put_in = totals.energy.put_in();
    // false for NaN
    let within = gain <= GAIN * put_in;
    (!within).then(|| {
        format!(
            "the bodies end with {gain:.2e} J more than the {put_in:.2e} J that loads and motions put in; use a \
             smaller dt or integrator = \"safe\""
        )
    })
}
