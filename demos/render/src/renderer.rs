//! Frames to pixels on a device: several pictures are under way at a time.

use crate::camera::Camera;
use crate::colour::{BODY_COLOURS, ColourMap, wound_colour, wound_shade};
use crate::error::RenderError;
use crate::image::Image;
use crate::look::Look;
use crate::pipelines::{Pipelines, Targets};
use crate::rigid::Placed;
use crate::scene::{Frame, Recording};
use crate::skin::Skin;
use crate::solids::{Instance, ball, cone, linear, rod};
use bytemuck::{Pod, Zeroable};
use glam::Vec3;
use glam::camera::rh;
use sinew_adapter::{Gpu, wgpu};
use std::collections::VecDeque;
use std::ops::Range;
use std::sync::{Arc, mpsc};

/// Pictures under way before the oldest is waited for.
const IN_FLIGHT: usize = 3;

/// Vertex of a surface.
#[repr(C)]
#[derive(Clone, Copy, Debug, Pod, Zeroable)]
struct Corner {
    place: [f32; 3],
    normal: [f32; 3],
    value: f32,
    tint: [f32; 4],
}

/// As `View` in `draw.wgsl`.
#[repr(C)]
#[derive(Clone, Copy, Debug, Pod, Zeroable)]
struct Uniforms {
    matrix: [f32; 16],
    light: [f32; 16],
    eye: [f32; 4],
    right: [f32; 4],
    up: [f32; 4],
    forward: [f32; 4],
    key: [f32; 4],
    world_up: [f32; 4],
    ground_x: [f32; 4],
    ground_y: [f32; 4],
    ground_centre: [f32; 4],
    flags: [f32; 4],
}

/// A buffer that grows.
struct Growing {
    buffer: wgpu::Buffer,
    usage: wgpu::BufferUsages,
}

impl Growing {
    fn new(device: &wgpu::Device, usage: wgpu::BufferUsages) -> Self {
        Self { buffer: buffer(device, 4096, usage), usage }
    }

    fn write(&mut self, gpu: &Gpu, bytes: &[u8]) {
        if bytes.len() as u64 > self.buffer.size() {
            self.buffer = buffer(&gpu.device, (bytes.len() as u64).next_power_of_two(), self.usage);
        }
        if !bytes.is_empty() {
            gpu.queue.write_buffer(&self.buffer, 0, bytes);
        }
    }
}

fn buffer(device: &wgpu::Device, size: u64, usage: wgpu::BufferUsages) -> wgpu::Buffer {
    let usage = usage | wgpu::BufferUsages::COPY_DST;
    device.create_buffer(&wgpu::BufferDescriptor {
        label: None,
        size,
        usage,
        mapped_at_creation: false,
    })
}

/// A surface on the device.
struct DeviceSkin {
    skin: Arc<Skin>,
    corners: Growing,
    indices: Growing,
    count: u32,
}

impl DeviceSkin {
    fn new(device: &wgpu::Device) -> Self {
        Self {
            skin: Arc::default(),
            corners: Growing::new(device, wgpu::BufferUsages::VERTEX),
            indices: Growing::new(device, wgpu::BufferUsages::INDEX),
            count: 0,
        }
    }

    fn write(&mut self, gpu: &Gpu, skin: &Arc<Skin>, corners: &[Corner]) {
        if !Arc::ptr_eq(skin, &self.skin) {
            self.indices.write(gpu, bytemuck::cast_slice(&skin.triangles));
            self.count = 3 * skin.triangles.len() as u32;
            self.skin = skin.clone();
        }
        self.corners.write(gpu, bytemuck::cast_slice(corners));
    }

    fn draw(&self, pass: &mut wgpu::RenderPass) {
        if self.count > 0 {
            pass.set_vertex_buffer(0, self.corners.buffer.slice(..));
            pass.set_index_buffer(self.indices.buffer.slice(..), wgpu::IndexFormat::Uint32);
            pass.draw_indexed(0..self.count, 0, 0..1);
        }
    }
}

/// Copies of a solid on the device.
struct DeviceSolid {
    vertices: wgpu::Buffer,
    indices: wgpu::Buffer,
    index_count: u32,
    instances: Growing,
    instance_count: u32,
}

impl DeviceSolid {
    fn new(gpu: &Gpu, (vertices, indices): (Vec<crate::solids::SolidVertex>, Vec<u32>)) -> Self {
        let filled = |bytes: &[u8], usage| {
            let buffer = buffer(&gpu.device, bytes.len() as u64, usage);
            gpu.queue.write_buffer(&buffer, 0, bytes);
            buffer
        };
        Self {
            vertices: filled(bytemuck::cast_slice(&vertices), wgpu::BufferUsages::VERTEX),
            indices: filled(bytemuck::cast_slice(&indices), wgpu::BufferUsages::INDEX),
            index_count: indices.len() as u32,
            instances: Growing::new(&gpu.device, wgpu::BufferUsages::VERTEX),
            instance_count: 0,
        }
    }

    fn write(&mut self, gpu: &Gpu, instances: &[Instance]) {
        self.instances.write(gpu, bytemuck::cast_slice(instances));
        self.instance_count = instances.len() as u32;
    }

    fn draw(&self, pass: &mut wgpu::RenderPass, copies: Range<u32>) {
        if !copies.is_empty() {
            pass.set_vertex_buffer(0, self.vertices.slice(..));
            pass.set_vertex_buffer(1, self.instances.buffer.slice(..));
            pass.set_index_buffer(self.indices.slice(..), wgpu::IndexFormat::Uint32);
            pass.draw_indexed(0..self.index_count, 0, copies);
        }
    }
}

/// A picture under way.
struct PendingFrame {
    buffer: wgpu::Buffer,
    mapped: mpsc::Receiver<Result<(), wgpu::BufferAsyncError>>,
}

/// Draws frames of one size, four samples a pixel.
pub struct Renderer {
    gpu: Gpu,
    width: u32,
    height: u32,
    pipelines: Pipelines,
    targets: Targets,
    uniforms: wgpu::Buffer,
    body: DeviceSkin,
    ghost: DeviceSkin,
    /// Tools, and those that one sees through.
    tools: [DeviceSkin; 2],
    /// Balls, rods and cones.
    solids: [DeviceSolid; 3],
    /// Rods and cones of arrows that shine through what is before them.
    shining: [Range<u32>; 2],
    map: Option<ColourMap>,
    pending: VecDeque<PendingFrame>,
    free: Vec<wgpu::Buffer>,
}

impl Renderer {
    /// Prepares pictures of `width` x `height` pixels.
    ///
    /// # Errors
    /// When the size is 0 or above what the adapter can do.
    pub fn new(gpu: Gpu, width: u32, height: u32) -> Result<Self, RenderError> {
        let most = gpu.device.limits().max_texture_dimension_2d;
        if width < 16 || height < 16 || width > most || height > most {
            let remedy = format!("give 16 to {most} pixels along each side");
            return Err(RenderError::Size { width, height, remedy });
        }
        let uniforms =
            buffer(&gpu.device, size_of::<Uniforms>() as u64, wgpu::BufferUsages::UNIFORM);
        let targets = Targets::new(&gpu.device, width, height);
        let pipelines = Pipelines::new(&gpu.device, &targets, &uniforms);
        let solids = [ball(), rod(), cone()].map(|solid| DeviceSolid::new(&gpu, solid));
        let (body, ghost) = (DeviceSkin::new(&gpu.device), DeviceSkin::new(&gpu.device));
        let tools = [0, 1].map(|_| DeviceSkin::new(&gpu.device));
        let (pending, free) = (VecDeque::new(), Vec::new());
        Ok(Self {
            gpu,
            width,
            height,
            pipelines,
            targets,
            uniforms,
            body,
            ghost,
            tools,
            solids,
            shining: [0..0, 0..0],
            map: None,
            pending,
            free,
        })
    }

    /// Width over height.
    pub fn aspect(&self) -> f32 {
        self.width as f32 / self.height as f32
    }

    /// Name of the adapter.
    pub fn adapter(&self) -> String {
        self.gpu.summary.to_string()
    }

    /// Hands a frame to the device; returns the oldest picture under way when there are enough of them. The
    /// recording must have passed [`Recording::check`].
    ///
    /// # Errors
    /// When the device fails.
    ///
    /// # Panics
    /// When an index of the frame is out of range.
    pub fn submit(
        &mut self,
        recording: &Recording,
        frame: &Frame,
        camera: &Camera,
        look: &Look,
    ) -> Result<Option<Image>, RenderError> {
        self.upload(recording, frame, camera, look);
        let mut encoder = self.gpu.device.create_command_encoder(&Default::default());
        self.encode(&mut encoder, look);
        let row = row_bytes(self.width);
        let size = u64::from(row) * u64::from(self.height);
        let read = self
            .free
            .pop()
            .unwrap_or_else(|| buffer(&self.gpu.device, size, wgpu::BufferUsages::MAP_READ));
        encoder.copy_texture_to_buffer(
            self.targets.resolved.as_image_copy(),
            wgpu::TexelCopyBufferInfo {
                buffer: &read,
                layout: wgpu::TexelCopyBufferLayout {
                    offset: 0,
                    bytes_per_row: Some(row),
                    rows_per_image: None,
                },
            },
            self.targets.resolved.size(),
        );
        self.gpu.queue.submit([encoder.finish()]);
        let (sender, mapped) = mpsc::channel();
        // the other end may be gone after an error
        read.map_async(wgpu::MapMode::Read, .., move |result| _ = sender.send(result));
        self.pending.push_back(PendingFrame { buffer: read, mapped });
        if self.pending.len() >= IN_FLIGHT { self.take().map(Some) } else { Ok(None) }
    }

    /// The oldest picture under way, `None` when there is none.
    ///
    /// # Errors
    /// When the device fails.
    pub fn finish_one(&mut self) -> Result<Option<Image>, RenderError> {
        if self.pending.is_empty() { Ok(None) } else { self.take().map(Some) }
    }

    /// One picture, waited for.
    ///
    /// # Errors
    /// When the device fails.
    ///
    /// # Panics
    /// As [`Renderer::submit`]; and when other pictures are under way.
    pub fn still(
        &mut self,
        recording: &Recording,
        frame: &Frame,
        camera: &Camera,
        look: &Look,
    ) -> Result<Image, RenderError> {
        assert!(self.pending.is_empty(), "pictures under way");
        self.submit(recording, frame, camera, look)?;
        self.take()
    }

    fn take(&mut self) -> Result<Image, RenderError> {
        let device = RenderError::Device;
        let pending = self.pending.pop_front().ok_or_else(|| device("no picture".into()))?;
        loop {
            match pending.mapped.try_recv() {
                Ok(result) => break result.map_err(|e| device(e.to_string()))?,
                Err(mpsc::TryRecvError::Empty) => {
                    let wait = wgpu::PollType::wait_indefinitely();
                    self.gpu.device.poll(wait).map_err(|e| device(e.to_string()))?;
                }
                Err(e) => return Err(device(e.to_string())),
            }
        }
        let row = row_bytes(self.width) as usize;
        let view = pending.buffer.get_mapped_range(..).map_err(|e| device(e.to_string()))?;
        let data =
            view.chunks_exact(row).flat_map(|r| &r[..4 * self.width as usize]).copied().collect();
        drop(view);
        pending.buffer.unmap();
        self.free.push(pending.buffer);
        Ok(Image { width: self.width, height: self.height, data })
    }

    fn upload(&mut self, recording: &Recording, frame: &Frame, camera: &Camera, look: &Look) {
        let size = recording.size();
        let uniforms = uniforms(recording, camera, look, size);
        self.gpu.queue.write_buffer(&self.uniforms, 0, bytemuck::bytes_of(&uniforms));
        let field = look.field.and_then(|i| recording.fields.get(i).zip(frame.fields.get(i)));
        if let Some((field, _)) = field
            && self.map != Some(field.map)
        {
            let table: Vec<u8> =
                field.map.table().into_iter().flat_map(|[r, g, b]| [r, g, b, 255]).collect();
            self.targets.write_colours(&self.gpu.queue, &table);
            self.map = Some(field.map);
        }
        let skin = &frame.skin;
        let normals = skin.normals(&frame.points);
        let corners: Vec<Corner> = (0..skin.points.len())
            .map(|v| {
                let point = skin.points[v] as usize;
                let mut tint = linear(BODY_COLOURS[skin.body[v] as usize % BODY_COLOURS.len()]);
                if let Some(depth) = skin.wound(v) {
                    tint = linear(wound_colour(wound_shade(depth, size)));
                }
                let mut value = 0.0;
                if let Some((field, values)) = field {
                    let [low, high] = field.range;
                    value = (values[point] - low) / (high - low).max(f32::MIN_POSITIVE);
                    tint[3] = 0.0;
                }
                Corner { place: frame.points[point], normal: normals[v], value, tint }
            })
            .collect();
        self.body.write(&self.gpu, skin, &corners);
        if look.ghost && !Arc::ptr_eq(&self.ghost.skin, &recording.rest_skin) {
            let skin = &recording.rest_skin;
            let normals = skin.normals(&recording.rest);
            let corners: Vec<Corner> = (skin.points.iter().zip(normals))
                .map(|(&point, normal)| Corner {
                    place: recording.rest[point as usize],
                    normal,
                    value: 0.0,
                    tint: [0.0; 4],
                })
                .collect();
            self.ghost.write(&self.gpu, skin, &corners);
        }
        for (device, clear) in self.tools.iter_mut().zip([false, true]) {
            let clear = |placed: &Placed| {
                let shape = &recording.shapes[placed.shape as usize];
                let behind = placed.local(camera.eye).z < 0.0;
                clear == if shape.plate { behind } else { look.glass || shape.hollow }
            };
            let (skin, corners) = tools(recording, frame.tools.iter().filter(|t| clear(t)));
            device.write(&self.gpu, &Arc::new(skin), &corners);
        }
        let ([balls, rods, cones], arrows) = instances(recording, frame, camera, look, size);
        // forces of tools act within them
        let through = !frame.tools.is_empty();
        self.shining = if through { [arrows, 0..cones.len() as u32] } else { [0..0, 0..0] };
        for (solid, instances) in self.solids.iter_mut().zip([balls, rods, cones]) {
            solid.write(&self.gpu, &instances);
        }
    }

    fn encode(&self, encoder: &mut wgpu::CommandEncoder, look: &Look) {
        let p = &self.pipelines;
        let t = &self.targets;
        // depth from the key light
        let mut pass = begin(encoder, "shadow", None, Some((&t.shadow, wgpu::StoreOp::Store)));
        pass.set_bind_group(0, &p.light_group, &[]);
        pass.set_pipeline(&p.light);
        self.body.draw(&mut pass);
        self.tools[0].draw(&mut pass);
        drop(pass);
        if look.ground {
            let mut pass = begin(encoder, "contact", Some((&t.contact[0], None)), None);
            pass.set_bind_group(0, &p.light_group, &[]);
            for pipeline in [&p.contact, &p.cast] {
                pass.set_pipeline(pipeline);
                self.body.draw(&mut pass);
                self.tools[0].draw(&mut pass);
            }
            drop(pass);
            for (i, pipeline) in p.blur.iter().enumerate() {
                let target = &t.contact[1 - i];
                let mut pass = begin(encoder, "blur", Some((target, None)), None);
                pass.set_bind_group(0, &p.blur_groups[i], &[]);
                pass.set_pipeline(pipeline);
                pass.draw(0..3, 0..1);
            }
        }
        let colour = Some((&t.samples, Some(&t.resolved_view)));
        let depth = Some((&t.depth, wgpu::StoreOp::Discard));
        let mut pass = begin(encoder, "picture", colour, depth);
        pass.set_bind_group(0, &p.group, &[]);
        pass.set_pipeline(&p.ground);
        pass.draw(0..3, 0..1);
        // before the bodies, which hide it: colours are seen through nothing
        if look.ghost {
            pass.set_pipeline(&p.ghost);
            self.ghost.draw(&mut pass);
        }
        pass.set_pipeline(&p.skin);
        self.body.draw(&mut pass);
        self.tools[0].draw(&mut pass);
        pass.set_pipeline(&p.solid);
        for solid in &self.solids {
            solid.draw(&mut pass, 0..solid.instance_count);
        }
        pass.set_pipeline(&p.glass);
        self.tools[1].draw(&mut pass);
        pass.set_pipeline(&p.hidden);
        for (solid, copies) in self.solids[1..].iter().zip(&self.shining) {
            solid.draw(&mut pass, copies.clone());
        }
    }
}

fn row_bytes(width: u32) -> u32 {
    (4 * width).next_multiple_of(wgpu::COPY_BYTES_PER_ROW_ALIGNMENT)
}

fn begin<'e>(
    encoder: &'e mut wgpu::CommandEncoder,
    label: &str,
    colour: Option<(&wgpu::TextureView, Option<&wgpu::TextureView>)>,
    depth: Option<(&wgpu::TextureView, wgpu::StoreOp)>,
) -> wgpu::RenderPass<'e> {
    let colours = colour.map(|(view, resolve_target)| wgpu::RenderPassColorAttachment {
        view,
        depth_slice: None,
        resolve_target,
        ops: wgpu::Operations {
            load: wgpu::LoadOp::Clear(wgpu::Color::BLACK),
            // samples are of no use once they are resolved
            store: match resolve_target {
                Some(_) => wgpu::StoreOp::Discard,
                None => wgpu::StoreOp::Store,
            },
        },
    });
    encoder.begin_render_pass(&wgpu::RenderPassDescriptor {
        label: Some(label),
        color_attachments: if colours.is_some() { std::slice::from_ref(&colours) } else { &[] },
        depth_stencil_attachment: depth.map(|(view, store)| {
            wgpu::RenderPassDepthStencilAttachment {
                view,
                depth_ops: Some(wgpu::Operations { load: wgpu::LoadOp::Clear(1.0), store }),
                stencil_ops: None,
            }
        }),
        ..Default::default()
    })
}

fn uniforms(recording: &Recording, camera: &Camera, look: &Look, size: f32) -> Uniforms {
    let up = recording.up;
    // from above, over the left shoulder
    let key = (camera.right * -0.55 + up * 1.0 - camera.forward * 0.75).normalize();
    let reach = 0.9 * size;
    let from = rh::view::look_to_mat4(look.middle + key * 2.0 * reach, -key, camera.right);
    let light =
        rh::proj::directx::orthographic(-reach, reach, -reach, reach, 0.2 * reach, 5.0 * reach)
            * from;
    // the ground's axes follow the camera's horizontal ones only by quarter turns: grid lines along the world's
    let x = if up.x.abs() > 0.9 { Vec3::Y } else { (Vec3::X - up * up.x).normalize() };
    let y = up.cross(x);
    let centre = look.middle + up * (look.floor - look.middle.dot(up));
    // grid lines at multiples of their distance
    let snap = |v: f32| (v / look.grid).round() * look.grid;
    let centre = x * snap(centre.dot(x)) + y * snap(centre.dot(y)) + up * look.floor;
    let with = |v: Vec3, w: f32| [v.x, v.y, v.z, w];
    Uniforms {
        matrix: camera.matrix().to_cols_array(),
        light: light.to_cols_array(),
        eye: with(camera.eye, size),
        right: with(camera.right * camera.tangents[0], 0.0),
        up: with(camera.up * camera.tangents[1], 0.0),
        forward: with(camera.forward, 0.0),
        key: with(key, 0.0),
        world_up: with(up, look.floor),
        ground_x: with(x, look.grid),
        ground_y: with(y, 1.5 * size),
        ground_centre: with(centre, look.shade),
        flags: [f32::from(u8::from(look.ground)), 0.0, 0.0, 0.0],
    }
}

/// Surface of some tools of a frame.
fn tools<'a>(
    recording: &Recording,
    chosen: impl Iterator<Item = &'a Placed>,
) -> (Skin, Vec<Corner>) {
    let (mut skin, mut corners) = (Skin::default(), Vec::new());
    for placed in chosen {
        let shape = &recording.shapes[placed.shape as usize];
        let (first, tint) = (corners.len() as u32, linear(shape.colour));
        corners.extend(shape.points.iter().zip(&shape.normals).map(|(&point, &normal)| Corner {
            place: placed.carry(point).to_array(),
            normal: placed.turned(normal).to_array(),
            value: 0.0,
            tint,
        }));
        skin.triangles.extend(shape.triangles.iter().map(|t| t.map(|v| first + v)));
    }
    (skin, corners)
}

/// Balls, rods and cones of a frame, and which of the rods belong to arrows.
fn instances(
    recording: &Recording,
    frame: &Frame,
    camera: &Camera,
    look: &Look,
    size: f32,
) -> ([Vec<Instance>; 3], Range<u32>) {
    let mut balls: Vec<Instance> =
        frame.balls.iter().map(|b| Instance::ball(b.centre, b.radius, b.colour)).collect();
    let (mut rods, mut cones) = (Vec::new(), Vec::new());
    for rod in &frame.rods {
        let [a, b] = rod.ends.map(Vec3::from_array);
        rods.extend(Instance::along(a, b - a, 0.0022 * size, rod.colour));
    }
    let first = rods.len() as u32;
    for arrow in &frame.arrows {
        let (to, along) = (Vec3::from_array(arrow.to), Vec3::from_array(arrow.along));
        let head = (0.4 * along.length()).min(0.05 * size);
        let tip = along.normalize_or_zero() * head;
        rods.extend(Instance::along(to - along, along - tip, 0.14 * head, arrow.colour));
        cones.extend(Instance::along(to - tip, tip, 0.4 * head, arrow.colour));
    }
    let arrows = first..rods.len() as u32;
    let mut edges = |points: &[[f32; 3]], creases: &[[u32; 2]], away: f32, radius: f32, colour| {
        for &edge in creases {
            let ends = edge.map(|v| {
                let p = Vec3::from_array(points[v as usize]);
                p + (p - camera.eye).normalize_or_zero() * away * size
            });
            rods.extend(Instance::along(ends[0], ends[1] - ends[0], radius * size, colour));
        }
    };
    if look.ghost {
        edges(&recording.rest, &recording.rest_skin.creases, 0.006, 0.0012, [150, 156, 166]);
    }
    if look.edges {
        edges(&frame.points, &frame.skin.creases, -0.001, 0.0016, [44, 48, 56]);
    }
    balls.shrink_to_fit();
    ([balls, rods, cones], arrows)
}
