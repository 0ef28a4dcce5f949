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
    /// Uniforms only, for passes that draw into what the others read.
    pub light_group: wgpu::BindGroup,
    pub blur_groups: [wgpu::BindGroup; 2],
    pub group: wgpu::BindGroup,
}

/// What distinguishes pipelines.
struct Kind<'a> {
    vertex: &'a str,
    fragment: Option<&'a str>,
    buffers: &'a [Option<wgpu::VertexBufferLayout<'a>>],
    format: Option<TextureFormat>,
    blend: Option<wgpu::BlendState>,
    depth: Option<wgpu::DepthStencilState>,
    cull: Option<wgpu::Face>,
    multisample: u32,
}

impl Pipelines {
    pub(crate) fn new(device: &wgpu::Device, targets: &Targets, uniforms: &wgpu::Buffer) -> Self {
        let module = device.create_shader_module(wgpu::include_wgsl!("draw.wgsl"));
        let sampler = |compare| {
            device.create_sampler(&wgpu::SamplerDescriptor {
                mag_filter: wgpu::FilterMode::Linear,
                min_filter: wgpu::FilterMode::Linear,
                compare,
                ..Default::default()
            })
        };
        let smooth = sampler(None);
        let compare = sampler(Some(wgpu::CompareFunction::LessEqual));
        let colours = targets.colours.create_view(&Default::default());
        // bindings of each kind of pass, by their numbers in the shader
        let entry = |binding| wgpu::BindGroupLayoutEntry {
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
        };
        let group = |bindings: &[u32], unblurred: &wgpu::TextureView| {
            let entries: Vec<_> = bindings.iter().map(|&b| entry(b)).collect();
            let layout = device.create_bind_group_layout(&wgpu::BindGroupLayoutDescriptor {
                label: None,
                entries: &entries,
            });
            let entries: Vec<_> = bindings
                .iter()
                .map(|&binding| wgpu::BindGroupEntry {
                    binding,
                    resource: match binding {
                        0 => uniforms.as_entire_binding(),
                        1 => wgpu::BindingResource::Sampler(&smooth),
                        2 => wgpu::BindingResource::Sampler(&compare),
                        3 => wgpu::BindingResource::TextureView(&colours),
                        4 => wgpu::BindingResource::TextureView(&targets.contact[0]),
                        5 => wgpu::BindingResource::TextureView(&targets.shadow),
                        _ => wgpu::BindingResource::TextureView(unblurred),
                    },
                })
                .collect();
            let group = device.create_bind_group(&wgpu::BindGroupDescriptor {
                label: None,
                layout: &layout,
                entries: &entries,
            });
            (layout, group)
        };
        let (light_layout, light_group) = group(&[0], &colours);
        let (blur_layout, across) = group(&[0, 1, 6], &targets.contact[0]);
        let (_, upright) = group(&[0, 1, 6], &targets.contact[1]);
        let (layout, main_group) = group(&[0, 1, 2, 3, 4, 5], &colours);

        let pipeline = |layout: &wgpu::BindGroupLayout, kind: Kind| {
            let pipeline_layout = device.create_pipeline_layout(&wgpu::PipelineLayoutDescriptor {
                label: None,
                bind_group_layouts: &[Some(layout)],
                immediate_size: 0,
            });
            let targets = [kind.format.map(|format| wgpu::ColorTargetState {
                format,
                blend: kind.blend,
                write_mask: wgpu::ColorWrites::ALL,
            })];
            device.create_render_pipeline(&wgpu::RenderPipelineDescriptor {
                label: Some(kind.vertex),
                layout: Some(&pipeline_layout),
                vertex: wgpu::VertexState {
                    module: &module,
                    entry_point: Some(kind.vertex),
                    compilation_options: Default::default(),
                    buffers: kind.buffers,
                },
                primitive: wgpu::PrimitiveState { cull_mode: kind.cull, ..Default::default() },
                depth_stencil: kind.depth,
                multisample: wgpu::MultisampleState {
                    count: kind.multisample,
                    ..Default::default()
                },
                fragment: kind.fragment.map(|entry| wgpu::FragmentState {
                    module: &module,
                    entry_point: Some(entry),
                    compilation_options: Default::default(),
                    targets: &targets,
                }),
                multiview_mask: None,
                cache: None,
            })
        };
        use VertexFormat::{Float32, Float32x3, Float32x4};
        let attributes = |formats: &[VertexFormat], first: u32| -> Vec<wgpu::VertexAttribute> {
            let mut offset = 0;
            let mut location = first;
            let attribute = |&format: &VertexFormat| {
                let attribute = wgpu::VertexAttribute { format, offset, shader_location: location };
                offset += format.size();
                location += 1;
                attribute
            };
            formats.iter().map(attribute).collect()
        };
        let corner = attributes(&[Float32x3, Float32x3, Float32, Float32x4], 0);
        let corner = [Some(wgpu::VertexBufferLayout {
            array_stride: 44,
            step_mode: wgpu::VertexStepMode::Vertex,
            attributes: &corner,
        })];
        let place = attributes(&[Float32x3], 0);
        let place = [Some(wgpu::VertexBufferLayout {
            array_stride: 44,
            step_mode: wgpu::VertexStepMode::Vertex,
            attributes: &place,
        })];
        let vertex = attributes(&[Float32x3, Float32x3], 0);
        let instance = attributes(&[Float32x3, Float32x3, Float32x3, Float32x3, Float32x4], 2);
        let solid = [
            Some(wgpu::VertexBufferLayout {
                array_stride: size_of::<SolidVertex>() as u64,
                step_mode: wgpu::VertexStepMode::Vertex,
                attributes: &vertex,
            }),
            Some(wgpu::VertexBufferLayout {
                array_stride: size_of::<Instance>() as u64,
                step_mode: wgpu::VertexStepMode::Instance,
                attributes: &instance,
            }),
        ];
        let depth = |write, compare, bias| wgpu::DepthStencilState {
            format: DEPTH,
            depth_write_enabled: Some(write),
            depth_compare: Some(compare),
            stencil: Default::default(),
            bias,
        };
        let none = wgpu::DepthBiasState::default;
        // faces that are steep to the light shade themselves without
        let slope = wgpu::DepthBiasState { constant: 2, slope_scale: 2.0, clamp: 0.0 };
        let (always, less) = (wgpu::CompareFunction::Always, wgpu::CompareFunction::Less);
        let main = |vertex, fragment, buffers, blend, depth, cull| {
            let (format, multisample) = (Some(COLOUR), MULTISAMPLE);
            let (fragment, depth) = (Some(fragment), Some(depth));
            pipeline(
                &layout,
                Kind { vertex, fragment, buffers, format, blend, depth, cull, multisample },
            )
        };
        let flat = |layout, vertex, fragment, buffers, blend| {
            let (format, fragment) = (Some(CONTACT), Some(fragment));
            let (depth, cull, multisample) = (None, None, 1);
            pipeline(
                layout,
                Kind { vertex, fragment, buffers, format, blend, depth, cull, multisample },
            )
        };
        // the nearest to the ground counts
        let largest = wgpu::BlendComponent {
            src_factor: wgpu::BlendFactor::One,
            dst_factor: wgpu::BlendFactor::One,
            operation: wgpu::BlendOperation::Max,
        };
        let largest = Some(wgpu::BlendState { color: largest, alpha: largest });
        let over = Some(wgpu::BlendState::ALPHA_BLENDING);
        Self {
            light: pipeline(
                &light_layout,
                Kind {
                    vertex: "light_vertex",
                    fragment: None,
                    buffers: &place,
                    format: None,
                    blend: None,
                    depth: Some(depth(true, less, slope)),
                    cull: None,
                    multisample: 1,
                },
            ),
            contact: flat(&light_layout, "contact_vertex", "contact_fragment", &place, largest),
            cast: flat(&light_layout, "cast_vertex", "cast_fragment", &place, largest),
            blur: ["blur_across", "blur_upright"]
                .map(|fragment| flat(&blur_layout, "screen_vertex", fragment, &[], None)),
            ground: main(
                "screen_vertex",
                "ground_fragment",
                &[],
                None,
                depth(false, always, none()),
                None,
            ),
            skin: main(
                "skin_vertex",
                "skin_fragment",
                &corner,
                None,
                depth(true, less, none()),
                None,
            ),
            ghost: main(
                "ghost_vertex",
                "ghost_fragment",
                &corner,
                over,
                depth(false, less, none()),
                Some(wgpu::Face::Back),
            ),
            solid: main(
                "solid_vertex",
                "solid_fragment",
                &solid,
                None,
                depth(true, less, none()),
                Some(wgpu::Face::Back),
            ),
            light_group,
            blur_groups: [across, upright],
            group: main_group,
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
