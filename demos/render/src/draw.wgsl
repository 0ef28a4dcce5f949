// All drawing: shadow map from the key light, contact shade on the ground, background with ground, surfaces,
// ghost, and small solids (balls, rods, arrows). Lengths in metres, colours in linear light.

struct View {
    matrix: mat4x4f,
    // from the key light: orthographic
    light: mat4x4f,
    // w: what belongs to the name after "and"
    eye: vec4f,           // and the size of the scene
    right: vec4f,         // times the tangent of half the field of view
    up: vec4f,            // likewise
    forward: vec4f,
    key: vec4f,           // towards the key light
    world_up: vec4f,      // and the height of the ground along it
    ground_x: vec4f,      // and the distance between grid lines
    ground_y: vec4f,      // and the radius at which the ground fades
    ground_centre: vec4f, // and half the side of the contact shade
    flags: vec4f,         // ground
}

@group(0) @binding(0) var<uniform> view: View;
@group(0) @binding(1) var smooth_sampler: sampler;
@group(0) @binding(2) var depth_sampler: sampler_comparison;
@group(0) @binding(3) var colours: texture_2d<f32>;
// red: nearness of bodies above the ground; green: shadow of the key light on it
@group(0) @binding(4) var contact: texture_2d<f32>;
@group(0) @binding(5) var shadow: texture_depth_2d;

const SKY = vec3f(0.96, 0.98, 1.0);
const BOUNCE = vec3f(0.80, 0.76, 0.72);

// Share of the key light that reaches a point, by a neighbourhood of three by three of the shadow map.
fn lit(place: vec3f, spread: f32) -> f32 {
    let clip = view.light * vec4f(place, 1.0);
    let at = vec2f(0.5 + 0.5 * clip.x, 0.5 - 0.5 * clip.y);
    var sum = 0.0;
    for (var i = 0; i < 3; i++) {
        for (var j = 0; j < 3; j++) {
            let step = (vec2f(f32(i), f32(j)) - 1.0) * spread;
            sum += textureSampleCompareLevel(shadow, depth_sampler, at + step, clip.z);
        }
    }
    return sum / 9.0;
}

// Key light, hemisphere, a weak fill from the camera and a rim against the background.
fn shade(albedo: vec3f, place: vec3f, normal: vec3f, gloss: f32) -> vec3f {
    let to_eye = normalize(view.eye.xyz - place);
    let size = view.eye.w;
    let reach = lit(place + normal * 0.012 * size, 0.0022);
    let facing = dot(normal, view.key.xyz);
    let key = smoothstep(-0.12, 1.0, facing) * mix(0.25, 1.0, reach);
    let sky = mix(BOUNCE, SKY, 0.5 + 0.5 * dot(normal, view.world_up.xyz));
    let fill = max(dot(normal, to_eye), 0.0);
    let light = sky * 0.42 + vec3f(1.0, 0.985, 0.96) * key * 0.56 + vec3f(0.16) * fill;
    let half_way = normalize(to_eye + view.key.xyz);
    let shine = pow(max(dot(normal, half_way), 0.0), 60.0) * gloss * reach;
    let rim = pow(1.0 - max(dot(normal, to_eye), 0.0), 4.0);
    return albedo * light + vec3f(shine) + SKY * rim * 0.10;
}

// ---- surfaces

struct Corner {
    @location(0) place: vec3f,
    @location(1) normal: vec3f,
    // place along the colour map, and whether the tint is taken instead
    @location(2) value: f32,
    @location(3) tint: vec4f,
}

struct Between {
    @builtin(position) clip: vec4f,
    @location(0) place: vec3f,
    @location(1) normal: vec3f,
    @location(2) value: f32,
    @location(3) tint: vec4f,
}

@vertex fn skin_vertex(corner: Corner) -> Between {
    return Between(view.matrix * vec4f(corner.place, 1.0), corner.place, corner.normal, corner.value, corner.tint);
}

@fragment fn skin_fragment(in: Between, @builtin(front_facing) front: bool) -> @location(0) vec4f {
    let normal = normalize(in.normal) * select(-1.0, 1.0, front);
    // texel centres at both ends
    let at = (clamp(in.value, 0.0, 1.0) * 255.0 + 0.5) / 256.0;
    let mapped = textureSampleLevel(colours, smooth_sampler, vec2f(at, 0.5), 0.0).rgb;
    let albedo = mix(mapped, in.tint.rgb, in.tint.a);
    return vec4f(shade(albedo, in.place, normal, 0.16), 1.0);
}

// Glass, and a plate from behind: clear, denser where it turns away.
@fragment fn glass_fragment(in: Between) -> @location(0) vec4f {
    let normal = normalize(in.normal);
    let turned = 1.0 - abs(dot(normal, normalize(view.eye.xyz - in.place)));
    return vec4f(shade(in.tint.rgb, in.place, normal, 0.3), 0.22 + 0.5 * turned * turned);
}

// The shape at rest, behind the bodies: clear in the middle, denser where it turns away.
@vertex fn ghost_vertex(corner: Corner) -> Between {
    return Between(view.matrix * vec4f(corner.place, 1.0), corner.place, corner.normal, 0.0, corner.tint);
}

@fragment fn ghost_fragment(in: Between) -> @location(0) vec4f {
    let to_eye = normalize(view.eye.xyz - in.place);
    let turned = 1.0 - abs(dot(normalize(in.normal), to_eye));
    let opacity = 0.10 + 0.32 * turned * turned;
    return vec4f(vec3f(0.36, 0.40, 0.46), opacity);
}

// Depth seen from the key light.
@vertex fn light_vertex(@location(0) place: vec3f) -> @builtin(position) vec4f {
    return view.light * vec4f(place, 1.0);
}

// ---- contact shade: how near to the ground bodies are, seen from above, then blurred

struct Above {
    @builtin(position) clip: vec4f,
    @location(0) height: f32,
}

@vertex fn contact_vertex(@location(0) place: vec3f) -> Above {
    let offset = place - view.ground_centre.xyz;
    let at = vec2f(dot(offset, view.ground_x.xyz), dot(offset, view.ground_y.xyz)) / view.ground_centre.w;
    return Above(vec4f(at, 0.5, 1.0), dot(place, view.world_up.xyz) - view.world_up.w);
}

@fragment fn contact_fragment(in: Above) -> @location(0) vec4f {
    let near = exp(-max(in.height, 0.0) / (0.30 * view.eye.w));
    return vec4f(near, 0.0, 0.0, 1.0);
}

// The shadow of the key light on the ground, in green.
@vertex fn cast_vertex(@location(0) place: vec3f) -> Above {
    let height = dot(place, view.world_up.xyz) - view.world_up.w;
    let offset = place - view.key.xyz * height / dot(view.key.xyz, view.world_up.xyz) - view.ground_centre.xyz;
    let at = vec2f(dot(offset, view.ground_x.xyz), dot(offset, view.ground_y.xyz)) / view.ground_centre.w;
    return Above(vec4f(at, 0.5, 1.0), height);
}

@fragment fn cast_fragment(in: Above) -> @location(0) vec4f {
    return vec4f(0.0, 1.0, 0.0, 1.0);
}

struct Screen {
    @builtin(position) clip: vec4f,
    @location(0) at: vec2f,
}

// A triangle that covers everything; `at` runs from -1 to 1, upward.
@vertex fn screen_vertex(@builtin(vertex_index) i: u32) -> Screen {
    let at = vec2f(f32(i & 1u) * 4.0 - 1.0, f32(i >> 1u) * 4.0 - 1.0);
    return Screen(vec4f(at, 1.0, 1.0), at);
}

@group(0) @binding(6) var unblurred: texture_2d<f32>;

fn blurred(at: vec2f, along: vec2f) -> vec4f {
    var sum = vec2f(0.0);
    var weights = 0.0;
    for (var i = -9; i <= 9; i++) {
        let x = f32(i) / 4.5;
        let weight = exp(-0.5 * x * x);
        let place = vec2f(0.5 + 0.5 * at.x, 0.5 - 0.5 * at.y) + along * f32(i) * 1.6 / 256.0;
        // the shadow is cast by a small light: a third of the blur
        let sharp = vec2f(0.5 + 0.5 * at.x, 0.5 - 0.5 * at.y) + along * f32(i) * 0.5 / 256.0;
        sum.x += weight * textureSampleLevel(unblurred, smooth_sampler, place, 0.0).r;
        sum.y += weight * textureSampleLevel(unblurred, smooth_sampler, sharp, 0.0).g;
        weights += weight;
    }
    return vec4f(sum / weights, 0.0, 1.0);
}

@fragment fn blur_across(in: Screen) -> @location(0) vec4f {
    return blurred(in.at, vec2f(1.0, 0.0));
}

@fragment fn blur_upright(in: Screen) -> @location(0) vec4f {
    return blurred(in.at, vec2f(0.0, 1.0));
}

// ---- background and ground

fn grid_line(at: vec2f, spacing: f32, width: vec2f) -> f32 {
    let distance = abs(fract(at / spacing - 0.5) - 0.5) * spacing;
    let line = 1.0 - smoothstep(vec2f(0.0), 1.3 * width, distance);
    // lines closer than a few pixels fade away
    let open = 1.0 - smoothstep(vec2f(0.06), vec2f(0.25), width / spacing);
    return max(line.x * open.x, line.y * open.y);
}

@fragment fn ground_fragment(in: Screen) -> @location(0) vec4f {
    var colour = mix(vec3f(0.83, 0.85, 0.875), vec3f(0.955, 0.962, 0.97), 0.5 + 0.5 * in.at.y);
    let ray = view.forward.xyz + view.right.xyz * in.at.x + view.up.xyz * in.at.y;
    let down = min(dot(ray, view.world_up.xyz), -1e-4);
    let t = (view.world_up.w - dot(view.eye.xyz, view.world_up.xyz)) / down;
    let place = view.eye.xyz + ray * t;
    let offset = place - view.ground_centre.xyz;
    let at = vec2f(dot(offset, view.ground_x.xyz), dot(offset, view.ground_y.xyz));
    let width = fwidth(at);
    let there = view.flags.x * step(dot(ray, view.world_up.xyz), -1e-4) * step(0.0, t);
    let r = length(at) / view.ground_y.w;
    let fade = there * exp(-r * r * 1.4);
    colour = mix(colour, vec3f(0.94, 0.945, 0.95), 0.75 * fade);
    let line = grid_line(at, view.ground_x.w, width);
    colour *= 1.0 - 0.085 * line * fade;
    let uv = vec2f(0.5 + 0.5 * at.x / view.ground_centre.w, 0.5 - 0.5 * at.y / view.ground_centre.w);
    let inside = step(abs(uv.x - 0.5), 0.5) * step(abs(uv.y - 0.5), 0.5);
    let shadow = textureSampleLevel(contact, smooth_sampler, uv, 0.0).rg * there * inside;
    colour *= (1.0 - 0.62 * shadow.x) * (1.0 - 0.15 * shadow.y * fade);
    return vec4f(colour, 1.0);
}

// ---- small solids

struct Part {
    @location(0) place: vec3f,
    @location(1) normal: vec3f,
    @location(2) x: vec3f,
    @location(3) y: vec3f,
    @location(4) z: vec3f,
    @location(5) origin: vec3f,
    @location(6) tint: vec4f,
}

@vertex fn solid_vertex(part: Part) -> Between {
    let place = part.origin + part.x * part.place.x + part.y * part.place.y + part.z * part.place.z;
    let normal = cross(part.y, part.z) * part.normal.x + cross(part.z, part.x) * part.normal.y
        + cross(part.x, part.y) * part.normal.z;
    return Between(view.matrix * vec4f(place, 1.0), place, normalize(normal), 0.0, part.tint);
}

@fragment fn solid_fragment(in: Between) -> @location(0) vec4f {
    return vec4f(shade(in.tint.rgb, in.place, normalize(in.normal), 0.22), 1.0);
}

// Seen through what is before it.
@fragment fn hidden_fragment(in: Between) -> @location(0) vec4f {
    return vec4f(shade(in.tint.rgb, in.place, normalize(in.normal), 0.0), 0.7);
}
