//! What all bodies of a device share: the opened adapter, pipelines, buffers made and read.

use std::collections::HashMap;
use std::sync::atomic::{AtomicU32, AtomicU64, Ordering};
use std::sync::{Mutex, MutexGuard, PoisonError, mpsc};
use std::time::Instant;

use bytemuck::{Pod, cast_slice};
use sinew_adapter::Gpu;
use sinew_adapter::wgpu::{self, BufferUsages};

use crate::error::GpuError;
use crate::report::Phase;
use crate::sources::{self, ShaderSource};

/// Threads of a workgroup, as in prelude.wgsl.
pub const GROUP: u32 = 256;
/// Workgroups a dimension of a dispatch may have.
const MAX_GROUPS: u32 = 65_535;
/// Passes of a step that can be timed; what comes after is counted but not timed.
const MAX_PASSES: u32 = 256;

/// Kind of a binding.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Binding {
    Uniform,
    Read,
    Write,
}

use Binding::{Read, Uniform, Write};

/// Bind-group layouts.
#[derive(Debug)]
pub struct Layouts {
    /// Vertex rows, sums and the state of conjugate gradients.
    pub solver: wgpu::BindGroupLayout,
    /// A part of a matrix, for products.
    pub part: wgpu::BindGroupLayout,
    /// Vertex rows for elements.
    pub rows: wgpu::BindGroupLayout,
    /// A chunk of elements.
    pub chunk: wgpu::BindGroupLayout,
    /// Forces of a chunk to vertices.
    pub gather: wgpu::BindGroupLayout,
    /// Blocks of a chunk to a part.
    pub assemble: wgpu::BindGroupLayout,
    /// Part to system.
    pub shift: wgpu::BindGroupLayout,
    /// Motions of aggregates in conjugate gradients.
    pub coarse: wgpu::BindGroupLayout,
    /// Part of a matrix to the coarse matrix.
    pub galerkin: wgpu::BindGroupLayout,
    /// Coarse matrix to its inverse.
    pub inverse: wgpu::BindGroupLayout,
}

/// An opened device with what was compiled for it.
pub struct Context {
    pub gpu: Gpu,
    pub layouts: Layouts,
    /// Largest binding (bytes); buffers of elements and matrices are cut to fit.
    pub binding_limit: u64,
    modules: Mutex<HashMap<&'static str, wgpu::ShaderModule>>,
    pipelines: Mutex<HashMap<(&'static str, &'static str), wgpu::ComputePipeline>>,
    timer: Option<Timer>,
    /// Bytes to and from the device, and submissions, since last asked.
    up: AtomicU64,
    down: AtomicU64,
    submissions: AtomicU32,
    /// Time (ns) that the host has waited for the device.
    waited: AtomicU64,
}

struct Timer {
    queries: wgpu::QuerySet,
    resolved: wgpu::Buffer,
    phases: Mutex<Vec<Phase>>,
    period: f64,
}

/// What the mutexes hold is whole at any time, so a panic elsewhere does not spoil it.
fn lock<T>(mutex: &Mutex<T>) -> MutexGuard<'_, T> {
    mutex.lock().unwrap_or_else(PoisonError::into_inner)
}

pub fn layout(device: &wgpu::Device, label: &str, bindings: &[Binding]) -> wgpu::BindGroupLayout {
    let entries: Vec<_> = (0..)
        .zip(bindings)
        .map(|(binding, kind)| wgpu::BindGroupLayoutEntry {
            binding,
            visibility: wgpu::ShaderStages::COMPUTE,
            ty: wgpu::BindingType::Buffer {
                ty: match kind {
                    Uniform => wgpu::BufferBindingType::Uniform,
                    Read => wgpu::BufferBindingType::Storage { read_only: true },
                    Write => wgpu::BufferBindingType::Storage { read_only: false },
                },
                has_dynamic_offset: false,
                min_binding_size: None,
            },
            count: None,
        })
        .collect();
    device.create_bind_group_layout(&wgpu::BindGroupLayoutDescriptor {
        label: Some(label),
        entries: &entries,
    })
}

impl Context {
    /// Takes over an opened adapter; `binding_limit` (bytes) may lower that of the adapter.
    pub fn new(gpu: Gpu, binding_limit: Option<u64>) -> Self {
        let device = &gpu.device;
        let layouts = Layouts {
            solver: layout(device, "solver", &[Uniform, Write, Read, Write, Write, Write]),
            part: layout(device, "part", &[Uniform, Read, Read, Read]),
            rows: layout(device, "rows", &[Uniform, Write, Write]),
            chunk: layout(device, "chunk", &[Uniform, Read, Read, Write, Write]),
            gather: layout(device, "gather", &[Uniform, Read, Read, Read]),
            assemble: layout(device, "assemble", &[Uniform, Read, Read, Read, Write]),
            shift: layout(
                device,
                "shift",
                &[Uniform, Uniform, Read, Read, Read, Write, Read, Write],
            ),
            coarse: layout(
                device,
                "coarse",
                &[Uniform, Write, Read, Write, Write, Uniform, Read, Read, Read, Write],
            ),
            galerkin: layout(
                device,
                "galerkin",
                &[Uniform, Uniform, Read, Read, Read, Read, Read, Read, Write],
            ),
            inverse: layout(device, "inverse", &[Uniform, Uniform, Read, Read, Write, Write]),
        };
        let limits = device.limits();
        let own = limits.max_storage_buffer_binding_size.min(limits.max_buffer_size);
        let timer = gpu.timestamps.then(|| Timer {
            queries: device.create_query_set(&wgpu::QuerySetDescriptor {
                label: Some("passes"),
                ty: wgpu::QueryType::Timestamp,
                count: 2 * MAX_PASSES,
            }),
            resolved: device.create_buffer(&wgpu::BufferDescriptor {
                label: Some("times of passes"),
                size: 16 * u64::from(MAX_PASSES),
                usage: BufferUsages::QUERY_RESOLVE | BufferUsages::COPY_SRC,
                mapped_at_creation: false,
            }),
            phases: Mutex::default(),
            period: f64::from(gpu.queue.get_timestamp_period()) * 1e-9,
        });
        Self {
            layouts,
            binding_limit: binding_limit.map_or(own, |limit| limit.min(own)),
            modules: Mutex::default(),
            pipelines: Mutex::default(),
            timer,
            up: AtomicU64::new(0),
            down: AtomicU64::new(0),
            submissions: AtomicU32::new(0),
            waited: AtomicU64::new(0),
            gpu,
        }
    }

    /// Refuses a buffer that no binding can show.
    pub fn fits(&self, what: &'static str, bytes: u64) -> Result<(), GpuError> {
        if bytes <= self.binding_limit {
            return Ok(());
        }
        let adapter = self.gpu.summary.to_string();
        Err(GpuError::TooLarge { what, bytes, limit: self.binding_limit, adapter })
    }

    /// Runs `make`, which creates buffers, and refuses when the device has no room for them.
    pub fn within_memory<T>(
        &self,
        make: impl FnOnce() -> Result<T, GpuError>,
    ) -> Result<T, GpuError> {
        let scope = self.gpu.device.push_error_scope(wgpu::ErrorFilter::OutOfMemory);
        let made = make();
        let found = pollster::block_on(scope.pop());
        match found {
            Some(error) => Err(GpuError::OutOfMemory {
                adapter: self.gpu.summary.to_string(),
                reason: error.to_string(),
            }),
            None => made,
        }
    }

    /// A storage buffer of `bytes` zeros; never empty.
    pub fn storage(&self, label: &str, bytes: u64) -> wgpu::Buffer {
        self.gpu.device.create_buffer(&wgpu::BufferDescriptor {
            label: Some(label),
            size: bytes.max(16).next_multiple_of(16),
            usage: BufferUsages::STORAGE | BufferUsages::COPY_DST | BufferUsages::COPY_SRC,
            mapped_at_creation: false,
        })
    }

    /// A storage buffer with contents.
    pub fn filled<T: Pod>(&self, label: &str, contents: &[T]) -> wgpu::Buffer {
        let buffer = self.storage(label, size_of_val(contents) as u64);
        self.write(&buffer, 0, contents);
        buffer
    }

    /// A uniform buffer with contents.
    pub fn uniform<T: Pod>(&self, label: &str, contents: &T) -> wgpu::Buffer {
        let buffer = self.gpu.device.create_buffer(&wgpu::BufferDescriptor {
            label: Some(label),
            size: size_of::<T>() as u64,
            usage: BufferUsages::UNIFORM | BufferUsages::COPY_DST,
            mapped_at_creation: false,
        });
        self.write(&buffer, 0, std::slice::from_ref(contents));
        buffer
    }

    /// Puts contents into a buffer before the next submission.
    pub fn write<T: Pod>(&self, buffer: &wgpu::Buffer, offset: u64, contents: &[T]) {
        if !contents.is_empty() {
            self.gpu.queue.write_buffer(buffer, offset, cast_slice(contents));
            self.up.fetch_add(size_of_val(contents) as u64, Ordering::Relaxed);
        }
    }

    pub fn bind(
        &self,
        layout: &wgpu::BindGroupLayout,
        buffers: &[&wgpu::Buffer],
    ) -> wgpu::BindGroup {
        let entries: Vec<_> = (0..)
            .zip(buffers)
            .map(|(binding, buffer)| wgpu::BindGroupEntry {
                binding,
                resource: buffer.as_entire_binding(),
            })
            .collect();
        let descriptor = wgpu::BindGroupDescriptor { label: None, layout, entries: &entries };
        self.gpu.device.create_bind_group(&descriptor)
    }

    /// The pipeline of an entry point, compiled when first asked for.
    pub fn pipeline(
        &self,
        name: &'static str,
        source: impl FnOnce() -> ShaderSource,
        entry: &'static str,
        groups: &[&wgpu::BindGroupLayout],
    ) -> wgpu::ComputePipeline {
        if let Some(pipeline) = lock(&self.pipelines).get(&(name, entry)) {
            return pipeline.clone();
        }
        let device = &self.gpu.device;
        let mut modules = lock(&self.modules);
        let module = modules.entry(name).or_insert_with(|| {
            device.create_shader_module(wgpu::ShaderModuleDescriptor {
                label: Some(name),
                source: wgpu::ShaderSource::Wgsl(source().text.into()),
            })
        });
        let groups: Vec<_> = groups.iter().map(|&layout| Some(layout)).collect();
        let layout = device.create_pipeline_layout(&wgpu::PipelineLayoutDescriptor {
            label: Some(name),
            bind_group_layouts: &groups,
            immediate_size: 0,
        });
        let pipeline = device.create_compute_pipeline(&wgpu::ComputePipelineDescriptor {
            label: Some(entry),
            layout: Some(&layout),
            module,
            entry_point: Some(entry),
            compilation_options: wgpu::PipelineCompilationOptions::default(),
            cache: None,
        });
        lock(&self.pipelines).insert((name, entry), pipeline.clone());
        pipeline
    }

    /// A kernel of one of the modules without elements.
    pub fn kernel(
        &self,
        module: &'static str,
        entry: &'static str,
        groups: &[&wgpu::BindGroupLayout],
    ) -> wgpu::ComputePipeline {
        self.pipeline(module, || sources::shared(module), entry, groups)
    }

    /// A kernel over vertex rows, without a matrix.
    pub fn vector_kernel(&self, entry: &'static str) -> wgpu::ComputePipeline {
        self.kernel("solver", entry, &[&self.layouts.solver])
    }

    /// A kernel with a part of a matrix.
    pub fn matrix_kernel(&self, entry: &'static str) -> wgpu::ComputePipeline {
        // a second name, since the layout differs
        let groups = [&self.layouts.solver, &self.layouts.part];
        self.pipeline("matrix", || sources::shared("solver"), entry, &groups)
    }

    /// Begins to record commands.
    pub fn record(&self) -> PassRecorder<'_> {
        let descriptor = wgpu::CommandEncoderDescriptor { label: None };
        PassRecorder { context: self, encoder: self.gpu.device.create_command_encoder(&descriptor) }
    }

    /// Bytes to the device, bytes back and submissions since this was last asked.
    pub fn take_traffic(&self) -> (u64, u64, u32) {
        let take = |counter: &AtomicU64| counter.swap(0, Ordering::Relaxed);
        (take(&self.up), take(&self.down), self.submissions.swap(0, Ordering::Relaxed))
    }

    /// Time (s) that the host has waited since this was last asked.
    pub fn take_waited(&self) -> f64 {
        self.waited.swap(0, Ordering::Relaxed) as f64 * 1e-9
    }

    /// Forgets the times of passes of the last step.
    pub fn restart_timer(&self) {
        if let Some(timer) = &self.timer {
            lock(&timer.phases).clear();
        }
    }

    /// Times (s) on the device of the passes since then, by phase, and whether all were timed; `None` when
    /// the adapter cannot tell.
    pub fn device_times(&self) -> Option<(Vec<(Phase, f64)>, bool)> {
        let timer = self.timer.as_ref()?;
        let phases = lock(&timer.phases).clone();
        let timed = (phases.len() as u32).min(MAX_PASSES);
        if timed == 0 {
            return Some((Vec::new(), true));
        }
        let mut recorder = self.record();
        recorder.encoder.resolve_query_set(&timer.queries, 0..2 * timed, &timer.resolved, 0);
        let pending = recorder.read(&timer.resolved, 0, 16 * u64::from(timed));
        recorder.submit();
        let ticks: Vec<u64> = pending.wait(self).ok()?;
        let times = phases
            .iter()
            .zip(ticks.chunks_exact(2))
            .map(|(&phase, ends)| (phase, ends[1].saturating_sub(ends[0]) as f64 * timer.period));
        Some((times.collect(), phases.len() as u32 <= MAX_PASSES))
    }
}

/// Workgroups for one thread each of `threads`.
pub fn groups_for(threads: u64) -> [u32; 2] {
    let groups = threads.div_ceil(u64::from(GROUP)).max(1);
    let rows = groups.div_ceil(u64::from(MAX_GROUPS));
    [groups.div_ceil(rows) as u32, rows as u32]
}

/// Commands being recorded.
pub struct PassRecorder<'a> {
    context: &'a Context,
    pub encoder: wgpu::CommandEncoder,
}

impl PassRecorder<'_> {
    /// Records a compute pass of a phase.
    pub fn pass(&mut self, phase: Phase, dispatch: impl FnOnce(&mut Pass<'_>)) {
        let timer = self.context.timer.as_ref().and_then(|timer| {
            let mut phases = lock(&timer.phases);
            let place = phases.len() as u32;
            phases.push(phase);
            (place < MAX_PASSES).then_some((timer, place))
        });
        let inner = self.encoder.begin_compute_pass(&wgpu::ComputePassDescriptor {
            label: Some(phase.name()),
            timestamp_writes: timer.map(|(timer, place)| wgpu::ComputePassTimestampWrites {
                query_set: &timer.queries,
                beginning_of_pass_write_index: Some(2 * place),
                end_of_pass_write_index: Some(2 * place + 1),
            }),
        });
        dispatch(&mut Pass { context: self.context, inner });
    }

    /// Asks for part of a buffer as it is at this point.
    pub fn read(&mut self, buffer: &wgpu::Buffer, offset: u64, bytes: u64) -> PendingRead {
        let staging = self.context.gpu.device.create_buffer(&wgpu::BufferDescriptor {
            label: Some("read back"),
            size: bytes,
            usage: BufferUsages::MAP_READ | BufferUsages::COPY_DST,
            mapped_at_creation: false,
        });
        self.encoder.copy_buffer_to_buffer(buffer, offset, &staging, 0, bytes);
        PendingRead { staging }
    }

    /// Hands the commands to the device.
    pub fn submit(self) {
        self.context.gpu.queue.submit([self.encoder.finish()]);
        self.context.submissions.fetch_add(1, Ordering::Relaxed);
    }
}

/// A compute pass being recorded.
pub struct Pass<'a> {
    pub context: &'a Context,
    inner: wgpu::ComputePass<'a>,
}

impl Pass<'_> {
    /// Runs a kernel with these bind groups, in the order of their numbers, over so many workgroups.
    pub fn run(
        &mut self,
        kernel: &wgpu::ComputePipeline,
        groups: &[&wgpu::BindGroup],
        [x, y]: [u32; 2],
    ) {
        self.inner.set_pipeline(kernel);
        for (number, group) in (0..).zip(groups) {
            self.inner.set_bind_group(number, *group, &[]);
        }
        self.inner.dispatch_workgroups(x, y, 1);
    }
}

/// Contents of a buffer on their way to the host.
pub struct PendingRead {
    staging: wgpu::Buffer,
}

impl PendingRead {
    /// Waits for them.
    pub fn wait<T: Pod>(self, context: &Context) -> Result<Vec<T>, GpuError> {
        let (send, receive) = mpsc::channel();
        self.staging.map_async(wgpu::MapMode::Read, .., move |result| {
            // nobody listens any more after an error of poll
            let _ = send.send(result);
        });
        let lost = |reason: String| GpuError::DeviceLost {
            adapter: context.gpu.summary.to_string(),
            reason,
        };
        let start = Instant::now();
        let polled = context.gpu.device.poll(wgpu::PollType::wait_indefinitely());
        context.waited.fetch_add(start.elapsed().as_nanos() as u64, Ordering::Relaxed);
        polled.map_err(|error| lost(error.to_string()))?;
        match receive.recv() {
            Ok(Ok(())) => {}
            Ok(Err(error)) => return Err(lost(error.to_string())),
            Err(error) => return Err(lost(error.to_string())),
        }
        let view = self.staging.get_mapped_range(..).map_err(|error| lost(error.to_string()))?;
        let contents = bytemuck::pod_collect_to_vec(&view[..]);
        context.down.fetch_add(view.len() as u64, Ordering::Relaxed);
        Ok(contents)
    }
}
