//! What the device computes outside a step: evaluations to compare with the processor, and timings.

use bevy_ecs::prelude::World;
use sinew_engine::law::TangentKind;
use sinew_engine::scalar::Scalar;
use std::time::Instant;

use crate::backend::GpuBackend;
use crate::body::{RowSlot, StepUniform, kind_number, total};
use crate::context::{Binding, groups_for, layout};
use crate::error::GpuError;
use crate::report::Phase;

/// Energies and forces as the device has them.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct DeviceEvaluation {
    /// Elastic energy of every body (J), with the potential of loads that are laws.
    pub energies: Vec<f64>,
    /// Elastic force on every vertex row (N); fourth entry padding.
    pub forces: Vec<[f32; 4]>,
}

/// Volume ratios of the solid elements of a body, at the Gauss points of those that have several.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct DeviceVolumes {
    /// Smallest ratio of deformed to rest volume; infinite where nothing is measured.
    pub smallest: f64,
    /// Elements with a ratio of zero or less somewhere.
    pub inverted: u64,
    /// Elements measured: all but those without a law of their own, such as in bodies of springs.
    pub elements: u64,
}

/// Times of force passes.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct ForceTiming {
    /// Passes in the times.
    pub passes: u32,
    /// Time (s) on the device, if it can be told.
    pub device_seconds: Option<f64>,
    /// Time (s) as the host sees it, from recording to the end.
    pub host_seconds: f64,
    /// Bytes that one pass has to move at least, every list and column once.
    pub bytes: u64,
}

impl GpuBackend {
    /// Elastic energies (J) and forces (N) at the displacements in the columns.
    ///
    /// # Errors
    /// When a law has no twin on the device, or the device gives up.
    pub fn evaluate<S: Scalar>(&mut self, world: &mut World) -> Result<DeviceEvaluation, GpuError> {
        self.prepare::<S>(world)?;
        let mut result = DeviceEvaluation::default();
        for resident in &self.bodies {
            let (context, body) = (&self.context, &resident.body);
            let mut recorder = body.look_back(context, StepUniform::default());
            body.energies(&mut recorder);
            body.forces(&mut recorder);
            let energies = body.read_energies(&mut recorder);
            let forces = body.read_rows(&mut recorder, RowSlot::Force);
            recorder.submit();
            let energies = energies.wait::<[f32; 4]>(context)?;
            result.energies.push(body.elements.sum_energies(&energies).total());
            result.forces.extend(forces.wait::<[f32; 4]>(context)?);
        }
        self.context.restart_timer();
        Ok(result)
    }

    /// Volume ratios of every body at the displacements in the columns.
    ///
    /// # Errors
    /// As [`evaluate`](Self::evaluate).
    pub fn volumes<S: Scalar>(
        &mut self,
        world: &mut World,
    ) -> Result<Vec<DeviceVolumes>, GpuError> {
        self.prepare::<S>(world)?;
        let mut result = Vec::with_capacity(self.bodies.len());
        for resident in &self.bodies {
            let (context, body) = (&self.context, &resident.body);
            let mut recorder = body.look_back(context, StepUniform::default());
            body.volumes(&mut recorder);
            let found = body.read_energies(&mut recorder);
            recorder.submit();
            let elements = body.elements.solid_elements();
            let found = found.wait::<[f32; 4]>(context)?;
            let least = found.iter().map(|x| f64::from(x[0])).fold(f64::INFINITY, f64::min);
            let smallest = if elements > 0 { least } else { f64::INFINITY };
            let inverted = if elements > 0 { total(&found, 1, 0, 1) as u64 } else { 0 };
            result.push(DeviceVolumes { smallest, inverted, elements });
        }
        self.context.restart_timer();
        Ok(result)
    }

    /// Product (N when `direction` is in m) of the tangent at the displacements in the columns with one row
    /// per vertex row.
    ///
    /// # Errors
    /// As [`evaluate`](Self::evaluate).
    pub fn multiply<S: Scalar>(
        &mut self,
        world: &mut World,
        kind: TangentKind,
        direction: &[[f32; 4]],
    ) -> Result<Vec<[f32; 4]>, GpuError> {
        self.prepare::<S>(world)?;
        let mut result = Vec::with_capacity(direction.len());
        for resident in &self.bodies {
            let (context, body) = (&self.context, &resident.body);
            let uniform = StepUniform { kind: kind_number(kind), ..StepUniform::default() };
            body.set(context, uniform);
            let rows = result.len()..result.len() + body.n as usize;
            body.write_rows(context, RowSlot::P, &direction[rows]);
            let mut recorder = context.record();
            recorder.pass(Phase::Rows, |pass| body.each_row(pass, "look_back"));
            body.tangent(&mut recorder, kind, false);
            recorder.pass(Phase::Solve, |pass| {
                body.product(pass, "product_plain", false);
                body.each_row(pass, "complete_product");
            });
            let product = body.read_rows(&mut recorder, RowSlot::Q);
            recorder.submit();
            result.extend(product.wait::<[f32; 4]>(context)?);
        }
        self.context.restart_timer();
        Ok(result)
    }

    /// Times force passes (elements and gather) at the displacements in the columns, `repeats` of them in one
    /// submission, energies left out.
    ///
    /// # Errors
    /// As [`evaluate`](Self::evaluate).
    pub fn time_forces<S: Scalar>(
        &mut self,
        world: &mut World,
        repeats: u32,
    ) -> Result<ForceTiming, GpuError> {
        self.prepare::<S>(world)?;
        let context = &self.context;
        let mut timing = ForceTiming { passes: repeats, ..ForceTiming::default() };
        for resident in &self.bodies {
            let body = &resident.body;
            // pipelines compiled, displacements in place
            let mut recorder = body.look_back(context, StepUniform::default());
            body.forces(&mut recorder);
            let ready = body.read_sums(&mut recorder, 1);
            recorder.submit();
            ready.wait::<[f32; 4]>(context)?;
            context.restart_timer();
            let start = Instant::now();
            let mut recorder = context.record();
            for _ in 0..repeats {
                body.forces(&mut recorder);
            }
            let done = body.read_sums(&mut recorder, 1);
            recorder.submit();
            done.wait::<[f32; 4]>(context)?;
            timing.host_seconds += start.elapsed().as_secs_f64();
            let timed = context.device_times().filter(|(_, all)| *all);
            let device =
                timed.map(|(times, _)| times.iter().map(|(_, seconds)| seconds).sum::<f64>());
            timing.device_seconds = match (timing.device_seconds, device) {
                (sum, Some(device)) => Some(sum.unwrap_or(0.0) + device),
                (_, None) => None,
            };
            timing.bytes += body.force_bytes();
            context.restart_timer();
        }
        Ok(timing)
    }

    /// Bandwidth (bytes/s, read and written) of a kernel that copies a buffer larger than the caches of devices.
    ///
    /// # Errors
    /// When the device gives up.
    pub fn copy_bandwidth(&self) -> Result<f64, GpuError> {
        const COPIES: u32 = 16;
        let context = &self.context;
        let bytes = context.binding_limit.min(512 << 20) / 16 * 16;
        let [from, to] = ["from", "to"].map(|label| context.storage(label, bytes));
        let layout = layout(&context.gpu.device, "copy", &[Binding::Read, Binding::Write]);
        let bind = context.bind(&layout, &[&from, &to]);
        let kernel = context.kernel("copy", "copy", &[&layout]);
        let groups = groups_for(bytes / 16);
        let run = |copies: u32| {
            let start = Instant::now();
            context.restart_timer();
            let mut recorder = context.record();
            recorder.pass(Phase::Rows, |pass| {
                (0..copies).for_each(|_| pass.run(&kernel, &[&bind], groups));
            });
            let done = recorder.read(&to, 0, 16);
            recorder.submit();
            done.wait::<[f32; 4]>(context)?;
            let host = start.elapsed().as_secs_f64();
            let device = context.device_times().map(|(times, _)| times[0].1);
            Ok::<_, GpuError>(device.unwrap_or(host))
        };
        run(1)?;
        let seconds = run(COPIES)?;
        context.restart_timer();
        Ok(2.0 * f64::from(COPIES) * bytes as f64 / seconds)
    }
}
