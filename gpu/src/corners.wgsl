// Corners and Gauss points of hexahedra; the first four, without the last coordinate, are those of quadrilaterals.

// Distance of the points from the middle; point q lies in the direction of corner q.
const GAUSS: f32 = 0.57735026;

// Local coordinates of corner a, each 1 or -1.
fn corner(a: u32) -> vec3f {
    return 2.0 * vec3f(vec3u((a ^ (a >> 1u)) & 1u, (a >> 1u) & 1u, a >> 2u)) - 1.0;
}
