//! Textures and pipelines.

use crate::colour::SAMPLES;
use crate::solids::{Instance, SolidVertex};
use sinew_adapter::wgpu;
use wgpu::{TextureFormat, VertexFormat};

/// Side (texels) of the shadow map.
pub(crate) const SHADOW_SIZE: u32 = 1024;
/// Side (texels) of the contact shade.
pub(crate) const CONTACT_SIZE: u32 = 256;
/// Samples a pixel.
const MULTISAMPLE: u32 = 4;
const COLOUR: TextureFormat = TextureFormat::Rgba8UnormSrgb;
const DEPTH: TextureFormat = TextureFormat::Depth32Float;
const CONTACT: TextureFormat = TextureFormat::Rg8Unorm;

/// What is drawn into.
pub(crate) struct Targets {
    pub samples: wgpu::TextureView,
    pub depth: wgpu::TextureView,
    pub resolved: wgpu::Texture,
    pub resolved_view: wgpu::TextureView,
    pub shadow: wgpu::TextureView,
    /// Drawn and blurred upright, blurred across.
    pub contact: [wgpu::TextureView; 2],
    colours: wgpu::Texture,
}

impl Targets {
    pub(crate) fn new(device: &wgpu::Device, width: u32, height: u32) -> Self {
        use wgpu::TextureUsages as U;
        let texture = |[width, height]: [u32; 2], format, sample_count, usage| {
            device.create_texture(&wgpu::TextureDescriptor {
                label: None,
                size: wgpu::Extent3d { width, height, depth_or_array_layers: 1 },
                mip_level_count: 1,
                sample_count,
                dimension: wgpu::TextureDimension::D2,
                format,
                usage,
                view_formats: &[],
            })
        };
        let size = [width, height];
        let view = |texture: wgpu::Texture| texture.create_view(&Default::default());
        let resolved = texture(size, COLOUR, 1, U::RENDER_ATTACHMENT | U::COPY_SRC);
        let sampled = U::RENDER_ATTACHMENT | U::TEXTURE_BINDING;
        Self {
            samples: view(texture(size, COLOUR, MULTISAMPLE, U::RENDER_ATTACHMENT)),
            depth: view(texture(size, DEPTH, MULTISAMPLE, U::RENDER_ATTACHMENT)),
            resolved_view: resolved.create_view(&Default::default()),
            resolved,
            shadow: view(texture([SHADOW_SIZE; 2], DEPTH, 1, sampled)),
            contact: [0, 1].map(|_| view(texture([CONTACT_SIZE; 2], CONTACT, 1, sampled))),
            colours: texture([SAMPLES as u32, 1], COLOUR, 1, U::TEXTURE_BINDING | U::COPY_DST),
        }
    }

    /// Fills the colour map: four bytes for each of its samples.
    pub(crate) fn write_colours(&self, queue: &wgpu::Queue, table: &[u8]) {
        let layout = wgpu::TexelCopyBufferLayout {
            offset: 0,
            bytes_per_row: Some(4 * SAMPLES as u32),
            rows_per_image: None,
        };
        queue.write_texture(self.colours.as_image_copy(), table, layout, self.colours.size());
    }
}

/// How things are drawn.
pub(crate) struct Pipelines {
    pub light: wgpu::RenderPipeline,
    pub contact: wgpu::RenderPipeline,
    pub cast: wgpu::RenderPipeline,
    pub blur: [wgpu::RenderPipeline; 2],
    pub ground: wgpu::RenderPipeline,
    pub skin: wgpu::RenderPipeline,
    pub ghost: wgpu::RenderPipeline,
    pub solid: wgpu::RenderPipeline,
    /// Tools that one sees through.
    pub glass: wgpu::RenderPipeline,
    /// Solids as far as something is before them.
    pub hidden: wgpu::RenderPipeline,
    /// Uniforms only, for passes that draw into what the others read.
    pub light_group: wgpu::BindGroup,
    pub blur_groups: [wgpu::BindGroup; 2],
    pub group: wgpu::BindGroup,
}

/// What distinguishes pipelines.
struct PipelineKind<'a> {
    vertex: &'a str,
    fragment: Option<&'a str>,
    buffers: &'a [Option<wgpu::VertexBufferLayout<'a>>],
    format: Option<TextureFormat>,
    blend: Option<wgpu::BlendState>,
    depth: Option<wgpu::DepthStencilState>,
    cull: Option<wgpu::Face>,
    multisample: u32,
}

impl<'a> PipelineKind<'a> {
    /// Draws into the picture.
    fn picture(
        [vertex, fragment]: [&'a str; 2],
        buffers: &'a [Option<wgpu::VertexBufferLayout<'a>>],
        depth: wgpu::DepthStencilState,
    ) -> Self {
        Self {
            vertex,
            fragment: Some(fragment),
            buffers,
            format: Some(COLOUR),
            blend: None,
            depth: Some(depth),
            cull: None,
            multisample: MULTISAMPLE,
        }
    }

    /// Draws into the contact shade.
    fn shade(
        [vertex, fragment]: [&'a str; 2],
        buffers: &'a [Option<wgpu::VertexBufferLayout<'a>>],
        blend: Option<wgpu::BlendState>,
    ) -> Self {
        let (fragment, format) = (Some(fragment), Some(CONTACT));
        Self { vertex, fragment, buffers, format, blend, depth: None, cull: None, multisample: 1 }
    }
}

/// Makes pipelines of the entry points of a shader.
struct Shader<'a> {
    device: &'a wgpu::Device,
    module: wgpu::ShaderModule,
}

impl Shader<'_> {
    fn pipeline(&self, layout: &wgpu::BindGroupLayout, kind: PipelineKind) -> wgpu::RenderPipeline {
        let layout = self.device.create_pipeline_layout(&wgpu::PipelineLayoutDescriptor {
            label: None,
            bind_group_layouts: &[Some(layout)],
            immediate_size: 0,
        });
        let targets = [kind.format.map(|format| wgpu::ColorTargetState {
            format,
            blend: kind.blend,
            write_mask: wgpu::ColorWrites::ALL,
        })];
        self.device.create_render_pipeline(&wgpu::RenderPipelineDescriptor {
            label: Some(kind.vertex),
            layout: Some(&layout),
            vertex: wgpu::VertexState {
                module: &self.module,
                entry_point: Some(kind.vertex),
                compilation_options: Default::default(),
                buffers: kind.buffers,
            },
            primitive: wgpu::PrimitiveState { cull_mode: kind.cull, ..Default::default() },
            depth_stencil: kind.depth,
            multisample: wgpu::MultisampleState { count: kind.multisample, ..Default::default() },
            fragment: kind.fragment.map(|entry| wgpu::FragmentState {
                module: &self.module,
                entry_point: Some(entry),
                compilation_options: Default::default(),
                targets: &targets,
            }),
            multiview_mask: None,
            cache: None,
        })
    }
}

/// What shaders read, by the number of its binding.
struct Resources<'a> {
    device: &'a wgpu::Device,
    targets: &'a Targets,
    uniforms: &'a wgpu::Buffer,
    colours: wgpu::TextureView,
    /// Samplers: smoothly, and to compare depths.
    smooth: wgpu::Sampler,
    compare: wgpu::Sampler,
}

impl<'a> Resources<'a> {
    fn new(device: &'a wgpu::Device, targets: &'a Targets, uniforms: &'a wgpu::Buffer) -> Self {
        let sampler = |compare| {
            device.create_sampler(&wgpu::SamplerDescriptor {
                mag_filter: wgpu::FilterMode::Linear,
                min_filter: wgpu::FilterMode::Linear,
                compare,
                ..Default::default()
            })
        };
        Self {
            device,
            targets,
            uniforms,
            colours: targets.colours.create_view(&Default::default()),
            smooth: sampler(None),
            compare: sampler(Some(wgpu::CompareFunction::LessEqual)),
        }
    }

    /// Layout and group of some bindings; `unblurred` is what a pass that blurs reads.
    fn group(
        &self,
        bindings: &[u32],
        unblurred: &wgpu::TextureView,
    ) -> (wgpu::BindGroupLayout, wgpu::BindGroup) {
        let entries: Vec<_> = bindings.iter().map(|&binding| layout_entry(binding)).collect();
        let layout = self.device.create_bind_group_layout(&wgpu::BindGroupLayoutDescriptor {
            label: None,
            entries: &entries,
        });
        let resource = |binding| match binding {
            0 => self.uniforms.as_entire_binding(),
            1 => wgpu::BindingResource::Sampler(&self.smooth),
            2 => wgpu::BindingResource::Sampler(&self.compare),
            3 => wgpu::BindingResource::TextureView(&self.colours),
            4 => wgpu::BindingResource::TextureView(&self.targets.contact[0]),
            5 => wgpu::BindingResource::TextureView(&self.targets.shadow),
            _ => wgpu::BindingResource::TextureView(unblurred),
        };
        let entry = |&binding: &u32| wgpu::BindGroupEntry { binding, resource: resource(binding) };
        let entries: Vec<_> = bindings.iter().map(entry).collect();
        let group = self.device.create_bind_group(&wgpu::BindGroupDescriptor {
            label: None,
            layout: &layout,
            entries: &entries,
        });
        (layout, group)
    }
}

/// Type of a binding, by its number in the shader.
fn layout_entry(binding: u32) -> wgpu::BindGroupLayoutEntry {
    wgpu::BindGroupLayoutEntry {
        binding,
        visibility: wgpu::ShaderStages::VERTEX_FRAGMENT,
        ty: match binding {
            0 => wgpu::BindingType::Buffer {
                ty: wgpu::BufferBindingType::Uniform,
                has_dynamic_offset: false,
                min_binding_size: None,
            },
            1 => wgpu::BindingType::Sampler(wgpu::SamplerBindingType::Filtering),
            2 => wgpu::BindingType::Sampler(wgpu::SamplerBindingType::Comparison),
            5 => texture_type(wgpu::TextureSampleType::Depth),
            _ => texture_type(wgpu::TextureSampleType::Float { filterable: true }),
        },
        count: None,
    }
}

/// Attributes that follow each other without gaps, from a location on.
fn attributes(formats: &[VertexFormat], first: u32) -> Vec<wgpu::VertexAttribute> {
    let mut offset = 0;
    let attribute = |(shader_location, &format): (u32, &VertexFormat)| {
        let attribute = wgpu::VertexAttribute { format, offset, shader_location };
        offset += format.size();
        attribute
    };
    (first..).zip(formats).map(attribute).collect()
}

/// A buffer with one entry of so many bytes for each vertex.
fn per_vertex(
    array_stride: u64,
    attributes: &[wgpu::VertexAttribute],
) -> Option<wgpu::VertexBufferLayout<'_>> {
    let step_mode = wgpu::VertexStepMode::Vertex;
    Some(wgpu::VertexBufferLayout { array_stride, step_mode, attributes })
}

/// Bytes of a corner of the skin.
const CORNER: u64 = 44;

impl Pipelines {
    pub(crate) fn new(device: &wgpu::Device, targets: &Targets, uniforms: &wgpu::Buffer) -> Self {
        use VertexFormat::{Float32, Float32x3, Float32x4};
        let module = device.create_shader_module(wgpu::include_wgsl!("draw.wgsl"));
        let shader = Shader { device, module };
        let resources = Resources::new(device, targets, uniforms);
        let (light_layout, light_group) = resources.group(&[0], &resources.colours);
        let (blur_layout, across) = resources.group(&[0, 1, 6], &targets.contact[0]);
        let (_, upright) = resources.group(&[0, 1, 6], &targets.contact[1]);
        let (layout, group) = resources.group(&[0, 1, 2, 3, 4, 5], &resources.colours);

        let corner = attributes(&[Float32x3, Float32x3, Float32, Float32x4], 0);
        let corner = [per_vertex(CORNER, &corner)];
        let place = attributes(&[Float32x3], 0);
        let place = [per_vertex(CORNER, &place)];
        let vertex = attributes(&[Float32x3, Float32x3], 0);
        let instance = attributes(&[Float32x3, Float32x3, Float32x3, Float32x3, Float32x4], 2);
        let solid = [
            per_vertex(size_of::<SolidVertex>() as u64, &vertex),
            Some(wgpu::VertexBufferLayout {
                array_stride: size_of::<Instance>() as u64,
                step_mode: wgpu::VertexStepMode::Instance,
                attributes: &instance,
            }),
        ];
        let depth = |write, compare| wgpu::DepthStencilState {
            format: DEPTH,
            depth_write_enabled: Some(write),
            depth_compare: Some(compare),
            stencil: Default::default(),
            bias: Default::default(),
        };
        let (always, less) = (wgpu::CompareFunction::Always, wgpu::CompareFunction::Less);
        // faces that are steep to the light shade themselves without
        let slope = wgpu::DepthBiasState { constant: 2, slope_scale: 2.0, clamp: 0.0 };
        // the nearest to the ground counts
        let largest = wgpu::BlendComponent {
            src_factor: wgpu::BlendFactor::One,
            dst_factor: wgpu::BlendFactor::One,
            operation: wgpu::BlendOperation::Max,
        };
        let largest = Some(wgpu::BlendState { color: largest, alpha: largest });
        let over = Some(wgpu::BlendState::ALPHA_BLENDING);
        let (written, read) = (depth(true, less), depth(false, less));
        let back = Some(wgpu::Face::Back);

        let light = PipelineKind {
            vertex: "light_vertex",
            fragment: None,
            buffers: &place,
            format: None,
            blend: None,
            depth: Some(wgpu::DepthStencilState { bias: slope, ..written.clone() }),
            cull: None,
            multisample: 1,
        };
        let contact = PipelineKind::shade(["contact_vertex", "contact_fragment"], &place, largest);
        let cast = PipelineKind::shade(["cast_vertex", "cast_fragment"], &place, largest);
        let blur = |fragment| PipelineKind::shade(["screen_vertex", fragment], &[], None);
        let ground =
            PipelineKind::picture(["screen_vertex", "ground_fragment"], &[], depth(false, always));
        let skin =
            PipelineKind::picture(["skin_vertex", "skin_fragment"], &corner, written.clone());
        let ghost =
            PipelineKind::picture(["ghost_vertex", "ghost_fragment"], &corner, read.clone());
        let behind = depth(false, wgpu::CompareFunction::Greater);
        let hidden = PipelineKind::picture(["solid_vertex", "hidden_fragment"], &solid, behind);
        let glass = PipelineKind::picture(["skin_vertex", "glass_fragment"], &corner, read);
        let solid = PipelineKind::picture(["solid_vertex", "solid_fragment"], &solid, written);
        Self {
            light: shader.pipeline(&light_layout, light),
            contact: shader.pipeline(&light_layout, contact),
            cast: shader.pipeline(&light_layout, cast),
            blur: ["blur_across", "blur_upright"]
                .map(|fragment| shader.pipeline(&blur_layout, blur(fragment))),
            ground: shader.pipeline(&layout, ground),
            skin: shader.pipeline(&layout, skin),
            ghost: shader.pipeline(&layout, PipelineKind { blend: over, cull: back, ..ghost }),
            solid: shader.pipeline(&layout, PipelineKind { cull: back, ..solid }),
            glass: shader.pipeline(&layout, PipelineKind { blend: over, cull: back, ..glass }),
            hidden: shader.pipeline(&layout, PipelineKind { blend: over, cull: back, ..hidden }),
            light_group,
            blur_groups: [across, upright],
            group,
        }
    }
}

fn texture_type(sample_type: wgpu::TextureSampleType) -> wgpu::BindingType {
    wgpu::BindingType::Texture {
        sample_type,
        view_dimension: wgpu::TextureViewDimension::D2,
        multisampled: false,
    }
}
