/* A liver-like organ hangs from its ligament, is drawn by a tool, and cut. Prints what the hand feels.
 *
 *     liver [MESH] [STEPS]
 */
#include "sinew.h"

#include <math.h>
#include <stdio.h>
#include <stdlib.h>

/* Ends with the text of the library when a call did not do what it was asked for. */
static void demand(sinew_status status) {
    if (status != SINEW_OK) {
        fprintf(stderr, "sinew, code %d: %s\n", (int)status, sinew_last_error());
        exit(1);
    }
}

/* Vertices of a group: ask how many, then once more with room for them. */
static uint32_t *group(sinew_simulation *sim, sinew_handle body, const char *name, size_t *count) {
    uint32_t *vertices;
    demand(sinew_group_vertices(sim, body, name, NULL, 0, count));
    vertices = malloc(*count * sizeof *vertices);
    if (vertices == NULL) {
        exit(1);
    }
    demand(sinew_group_vertices(sim, body, name, vertices, *count, count));
    return vertices;
}

int main(int argc, char **argv) {
    const char *path = argc > 1 ? argv[1] : "demos/meshes/liver.msh";
    const uint32_t steps = argc > 2 ? (uint32_t)atoi(argv[2]) : 60;
    sinew_simulation *sim = NULL;
    sinew_mesh *mesh = NULL;
    sinew_handle liver, ligament, tool;
    size_t held_count, gripped_count, vertices, indices, removed = 0;
    uint64_t revision, before, hash;
    uint32_t i;

    if (sinew_abi_version() != SINEW_ABI) {
        fprintf(stderr, "header and library do not belong together\n");
        return 1;
    }

    sinew_options options = {0};
    options.struct_size = sizeof options;
    options.threads = 1;
    options.dt = 0.01;
    options.gravity[2] = -9.81;
    demand(sinew_simulation_new(&options, &sim));
    demand(sinew_set_solver(sim, "mass_damping = 4.0"));

    sinew_material material = {0};
    material.struct_size = sizeof material;
    material.preset = "liver";
    sinew_body body = {0};
    body.struct_size = sizeof body;
    body.name = "liver";
    body.material = &material;
    demand(sinew_mesh_from_file(path, &mesh));
    demand(sinew_body_add(sim, mesh, &body, &liver));
    sinew_mesh_free(mesh);

    uint32_t *held = group(sim, liver, "ligament", &held_count);
    uint32_t *gripped = group(sim, liver, "tool", &gripped_count);
    demand(sinew_hold(sim, liver, "ligament", held, held_count, &ligament));
    demand(sinew_hold(sim, liver, "tool", gripped, gripped_count, &tool));

    demand(sinew_vertex_count(sim, liver, &vertices));
    /* as a graphics library would have it: position, then something else */
    const size_t stride = 6 * sizeof(float);
    float *buffer = calloc(vertices, stride);
    if (buffer == NULL) {
        return 1;
    }
    for (i = 1; i <= steps; i++) {
        const double way = 0.03 * i / steps;
        const double place[3] = {way, 0.0, way};
        double force[3];
        demand(sinew_constraint_pose(sim, tool, place, NULL, NULL));
        demand(sinew_step(sim, 1));
        demand(sinew_positions_f32(sim, liver, buffer, vertices, stride));
        if (i % 10 == 0) {
            demand(sinew_reaction(sim, tool, NULL, force, NULL));
            printf("step %2u: %.1f mm, %.3f N\n", (unsigned)i, 1e3 * sqrt(2.0) * way,
                   sqrt(force[0] * force[0] + force[1] * force[1] + force[2] * force[2]));
        }
    }

    demand(sinew_surface(sim, liver, NULL, 0, &indices, &before));
    sinew_region ball = {0};
    ball.struct_size = sizeof ball;
    ball.kind = SINEW_BALL;
    ball.radius = 0.02;
    for (i = 0; i < 3; i++) {
        ball.from[i] = buffer[6 * gripped[0] + i];
    }
    demand(sinew_remove_elements(sim, liver, &ball, &removed));
    demand(sinew_surface(sim, liver, NULL, 0, &indices, &revision));
    demand(sinew_step(sim, 2));
    demand(sinew_hash(sim, &hash));
    printf("%zu elements cut away, surface of %zu triangles%s, state %016llx\n", removed, indices / 3,
           revision != before ? " (new)" : "", (unsigned long long)hash);

    /* what is wrong is a code and a text */
    if (sinew_step(NULL, 1) != SINEW_ARGUMENT || sinew_remove(sim, 12345) != SINEW_HANDLE) {
        return 1;
    }
    printf("and for a wrong handle: %s\n", sinew_last_error());

    free(buffer);
    free(held);
    free(gripped);
    sinew_simulation_free(sim);
    return 0;
}
