"""Makes lump.msh: a block of 120 x 70 x 35 mm in hexahedra of 5 mm with a stiff ball in it, which the cell data
`young_modulus` (Pa) tells and nothing else shows."""

CELLS = (24, 14, 7)
EDGE = 0.005
CENTRE = (0.075, 0.035, 0.020)
RADIUS = 0.0101
SOFT, STIFF = 4e3, 8e4

nx, ny, nz = CELLS


def vertex(i, j, k):
    return 1 + i + (nx + 1) * (j + (ny + 1) * k)


def corners(i, j, k):
    ring = [(0, 0), (1, 0), (1, 1), (0, 1)]
    return [vertex(i + a, j + b, k + c) for c in (0, 1) for a, b in ring]


with open("lump.msh", "w") as out:
    say = lambda *words: print(*words, file=out)
    say("$MeshFormat\n2.2 0 8\n$EndMeshFormat")
    say('$PhysicalNames\n3\n2 1 "bottom"\n2 2 "top"\n3 3 "body"\n$EndPhysicalNames')
    points = [(i, j, k) for k in range(nz + 1) for j in range(ny + 1) for i in range(nx + 1)]
    say(f"$Nodes\n{len(points)}")
    for i, j, k in points:
        say(vertex(i, j, k), *(f"{EDGE * c:g}" for c in (i, j, k)))
    say("$EndNodes")
    flat = [(i, j) for j in range(ny) for i in range(nx)]
    faces = [(1, corners(i, j, 0)[3::-1]) for i, j in flat]
    faces += [(2, corners(i, j, nz - 1)[4:]) for i, j in flat]
    cells = [(i, j, k) for k in range(nz) for j in range(ny) for i in range(nx)]
    say(f"$Elements\n{len(faces) + len(cells)}")
    for number, (group, face) in enumerate(faces, 1):
        say(number, 3, 2, group, group, *face)
    for number, cell in enumerate(cells, 1 + len(faces)):
        say(number, 5, 2, 3, 3, *corners(*cell))
    say("$EndElements")
    say(f'$ElementData\n1\n"young_modulus"\n1\n0\n3\n0\n1\n{len(cells)}')
    for number, cell in enumerate(cells, 1 + len(faces)):
        arm = [EDGE * (c + 0.5) - x for c, x in zip(cell, CENTRE)]
        inside = sum(d * d for d in arm) <= RADIUS * RADIUS
        say(number, f"{STIFF if inside else SOFT:g}")
    say("$EndElementData")
