"""A beam, or a block under a ball or under another block, as MuJoCo flexes, driven by one JSON request per line of standard input.

Every answer is one JSON line on standard output; {"error": ...} when a request fails. Requests:

  {"op": "version"}
  {"op": "load", "key": "full", "trilinear" or "quadratic", "cells": [n, n, n] or null, "mesh": PATH,
   "young": Pa, "poisson": -, "gravity": m/s^2}
  {"op": "time", "key": name, "h": s, "steps": n, "iterations": n, "start": PATH or null}
  {"op": "settle", "key": name, "h": s, "steps": n, "iterations": n, "damping": 1/s,
   "start": PATH or null}
  {"op": "swing", "key": name, "h": s, "steps": n, "every": n, "iterations": n, "start": PATH or null}
  {"op": "force", "key": name, "repeats": n}
  {"op": "touch-load", "key": name, "mesh": PATH, "young": Pa, "poisson": -, "gravity": m/s^2,
   "damping": 1/s, "h": s, "option": {attribute: value}, "contact": {attribute: value},
   "friction": -, "radius": m or null, "held": [n, ...] or null, "at": [x, y, z]}
  {"op": "touch", "key": name, "places": [[x, y, z], ...]}

`touch-load` with `radius` puts a ball over the block, with `held` a second block, of which these vertices are moved.
`touch` makes a step per place of the ball or second block and answers with its force in each. PATH of `load` is the JSON that Sinew writes: points, tetrahedra, fixed, masses. `start` is a JSON
list of displacements, three per vertex. `load` with cells makes a flex that the nodes of a grid move; these must be
the vertices of the mesh, in its order. `swing` answers with the displacements after every `every` steps. Needs `pip install mujoco` (version 4 or later).
"""

import json
import sys
import time

import mujoco
import numpy as np


# beams by what moves them, and blocks under a ball, by key
BEAMS, TOUCHES = {}, {}


def words(array):
    return " ".join(map(repr, array.ravel().tolist()))


def attributes(values):
    return " ".join(f'{name}="{value}"' for name, value in values.items())


class Beam:
    contact = '<contact contype="0" conaffinity="0" selfcollide="none"/>'
    radius = 1e-4
    option = ""

    def __init__(self, request):
        with open(request["mesh"]) as file:
            mesh = json.load(file)
        self.points = np.array(mesh["points"])
        elements = np.array(mesh["tetrahedra"])
        masses = np.array(mesh["masses"])
        fixed = np.array(mesh["fixed"])
        self.free = np.setdiff1d(np.arange(len(self.points)), fixed)
        self.n_elements = len(elements)
        if not hasattr(mujoco.mjtIntegrator, "mjINT_DISCRETE"):
            raise RuntimeError(
                "this MuJoCo has no discrete integrator: pip install --upgrade mujoco (4 or later)"
            )
        cells = request.get("cells")
        dof = request["key"] if cells else "full"
        grid = f'dof="{dof}" cellcount="{" ".join(map(str, cells))}"' if cells else 'dof="full"'
        how = f'<elasticity young="{request["young"]!r}" poisson="{request["poisson"]!r}"/>{self.contact}'
        before, after = self.others(request, elements, masses, how)
        xml = f"""<mujoco><option integrator="discrete" gravity="0 0 {-request["gravity"]!r}" {self.option}/>
<size memory="8G"/><worldbody>{before}
<flexcomp name="beam" type="direct" dim="3" {grid} mass="{float(masses.sum())!r}" radius="{self.radius!r}"
 point="{words(self.points)}" element="{words(elements)}">
{how}<pin id="{words(fixed)}"/></flexcomp>{after}
</worldbody></mujoco>"""
        start = time.perf_counter()
        self.model = mujoco.MjModel.from_xml_string(xml)
        self.iterations = int(self.model.opt.iterations)
        if cells:
            # it shares all the mass out among the free nodes: a part of it belongs to the held ones
            body = self.model.flex_nodebodyid
            share = (6 if dof == "quadratic" else 2) * cells[0]
            masses[self.free] = self.model.body_mass[body[self.free]] * (1 - 1 / share)
        else:
            # flexcomp gives every vertex the same mass; ours are lumped from the elements
            body = self.model.flex_vertbodyid
        self.model.body_mass[body[self.free]] = masses[self.free]
        self.data = mujoco.MjData(self.model)
        mujoco.mj_setConst(self.model, self.data)
        if cells:
            mujoco.mj_kinematics(self.model, self.data)
            off = np.setdiff1d(self.free, np.arange(len(body)))
            if len(off) or np.abs(self.data.xpos[body] - self.points)[self.free].max() > 1e-9:
                raise RuntimeError("the nodes of the grid are not the vertices of the mesh")
        # one body with three slides per free vertex
        adr = self.model.body_dofadr[body[self.free]]
        if not np.all(self.model.body_dofnum[body[self.free]] == 3):
            raise RuntimeError("a free flex vertex has not three degrees of freedom")
        self.dofs = (adr[:, None] + np.arange(3)).ravel()
        self.dof_mass = np.repeat(masses[self.free], 3)
        self.seconds = time.perf_counter() - start

    def others(self, request, elements, masses, how):
        """What stands before and after the beam in the world."""
        return "", ""

    def reset(self, request, damping):
        mujoco.mj_resetData(self.model, self.data)
        self.model.opt.timestep = request["h"]
        self.model.opt.iterations = request["iterations"]
        start = request["start"]
        self.model.dof_damping[self.dofs] = damping * self.dof_mass
        if start:
            with open(start) as file:
                u = np.array(json.load(file)).reshape(-1, 3)
            self.data.qpos[self.dofs] = u[self.free].ravel()
        mujoco.mj_forward(self.model, self.data)

    def steps(self, n):
        milliseconds = []
        for _ in range(n):
            start = time.perf_counter()
            mujoco.mj_step(self.model, self.data)
            milliseconds.append((time.perf_counter() - start) * 1e3)
        return milliseconds

    def swing(self, n, every):
        states = []
        for _ in range(n // every):
            self.steps(every)
            states.append(self.displacements().tolist())
        return states

    def displacements(self):
        mujoco.mj_kinematics(self.model, self.data)
        mujoco.mj_flex(self.model, self.data)
        return (self.data.flexvert_xpos - self.points).ravel()

    def force(self, repeats):
        """Seconds of the passive forces, and of the flex kinematics they need (medians)."""
        mujoco.mj_forward(self.model, self.data)
        result = []
        for function in (mujoco.mj_passive, mujoco.mj_flex):
            seconds = []
            for _ in range(repeats):
                start = time.perf_counter()
                function(self.model, self.data)
                seconds.append(time.perf_counter() - start)
            result.append(float(np.median(seconds)))
        return result


class Touch(Beam):
    """A block under a ball whose motion is given.

    Without friction the ball is a mocap body. For MuJoCo such a body is always at rest, so that nothing
    would drag: with friction the ball has two slides, whose place and speed are set before every step,
    and a mass that a step cannot move.
    """

    # the ball meets the surface itself, not one that is inflated
    radius = 1e-6

    def __init__(self, request):
        friction = request["friction"]
        soft = attributes(request["contact"])
        self.how = f'condim="{3 if friction else 1}" friction="{friction!r} 0 0" {soft}'
        self.option = f'timestep="{request["h"]!r}" {attributes(request["option"])}'
        self.contact = f'<contact selfcollide="none" {self.how}/>'
        self.at = np.array(request["at"])
        super().__init__(request)
        self.hand(request)
        self.model.dof_damping[self.dofs] = request["damping"] * self.dof_mass
        # the solver's tolerance is relative to it: that of what is free alone
        self.model.stat.meaninertia = float(self.dof_mass.mean())
        self.last = self.at
        mujoco.mj_forward(self.model, self.data)

    def others(self, request, elements, masses, how):
        friction = request["friction"]
        slides = '<joint type="slide" axis="1 0 0"/><joint type="slide" axis="0 0 1"/>'
        ball = f"""<body name="ball" pos="{words(self.at)}" {"" if friction else 'mocap="true"'}>{slides if friction else ""}
<geom name="ball" type="sphere" size="{request["radius"]!r}" mass="10" {self.how}/></body>"""
        return ball, ""

    def hand(self, request):
        """What is moved: `held`, degrees of freedom along the axes `along`."""
        self.along = [0, 2]
        self.held = None
        if request["friction"]:
            body = mujoco.mj_name2id(self.model, mujoco.mjtObj.mjOBJ_BODY, "ball")
            self.held = self.model.body_dofadr[body] + np.arange(2)

    def move(self, place):
        if self.held is None:
            self.data.mocap_pos[0] = place
            return
        # every joint is a slide, so that places and speeds have the same index
        at, speed = self.last - self.at, (place - self.last) / self.model.opt.timestep
        self.data.qpos[self.held] = at[self.along]
        self.data.qvel[self.held] = speed[self.along]
        self.last = place

    def comes_first(self, contact):
        """Whether the ball is the first side of a contact."""
        return contact.geom[0] >= 0

    def felt(self):
        """Normal force and friction on the ball or second block (N)."""
        total, part = np.zeros((2, 3)), np.zeros(6)
        for i, contact in enumerate(self.data.contact):
            mujoco.mj_contactForce(self.model, self.data, i, part)
            # the first axis leads from the first side to the second; the force is that on the second
            sign = -1.0 if self.comes_first(contact) else 1.0
            frame = sign * contact.frame.reshape(3, 3)
            total[0] += part[0] * frame[0]
            total[1] += part[1:3] @ frame[1:]
        return total

    def touch(self, places):
        milliseconds, forces = [], []
        for place in np.array(places):
            self.move(place)
            milliseconds += self.steps(1)
            forces.append(self.felt().ravel().tolist())
        return milliseconds, forces


class Pair(Touch):
    """A block under another one, of which some vertices are moved: they have a mass that a step cannot move."""

    def others(self, request, elements, masses, how):
        self.masses = masses
        upper = f"""<flexcomp name="upper" type="direct" dim="3" dof="full" mass="{float(masses.sum())!r}"
 radius="{self.radius!r}" point="{words(self.points + self.at)}" element="{words(elements)}">{how}</flexcomp>"""
        return "", upper

    def hand(self, request):
        n, held = len(self.points), np.array(request["held"])
        free = np.setdiff1d(np.arange(n), held)
        body = self.model.flex_vertbodyid[n:]
        self.model.body_mass[body[free]] = self.masses[free]
        self.model.body_mass[body[held]] = 10
        mujoco.mj_setConst(self.model, self.data)
        dofs = self.model.body_dofadr[body][:, None] + np.arange(3)
        self.held, self.along = dofs[held], slice(None)
        self.dofs = np.concatenate([self.dofs, dofs[free].ravel()])
        self.dof_mass = np.concatenate([self.dof_mass, np.repeat(self.masses[free], 3)])
        self.points = np.concatenate([self.points, self.points + self.at])
        self.n_elements *= 2

    def comes_first(self, contact):
        return contact.flex[0] == 1


def answer(request, warnings):
    op = request["op"]
    if op == "touch-load":
        # the body of an earlier case goes before the next is made
        TOUCHES.pop(request["key"], None)
        kind = Pair if request["held"] else Touch
        block = TOUCHES[request["key"]] = kind(request)
        return {
            "iterations": block.iterations,
            "nodes": len(block.points),
            "elements": block.n_elements,
            "h": block.model.opt.timestep,
        }
    if op == "touch":
        block = TOUCHES[request["key"]]
        milliseconds, forces = block.touch(request["places"])
        if not np.isfinite(block.data.qpos).all():
            raise FloatingPointError("the state is not finite")
        u = block.displacements().tolist()
        reply = {"milliseconds": milliseconds, "forces": forces, "displacements": u}
        return reply | {"warnings": list(warnings)}
    if op == "version":
        return {"version": mujoco.__version__}
    if op == "load":
        beam = BEAMS[request["key"]] = Beam(request)
        return {
            "iterations": beam.iterations,
            "nodes": len(beam.points),
            "elements": beam.n_elements,
            "seconds": beam.seconds,
        }
    beam = BEAMS[request["key"]]
    if op == "time":
        beam.reset(request, 0.0)
        reply = {"milliseconds": beam.steps(request["steps"])}
    elif op == "settle":
        beam.reset(request, request["damping"])
        beam.steps(request["steps"])
        reply = {"displacements": beam.displacements().tolist()}
        reply["speed"] = float(np.abs(beam.data.qvel).max())
    elif op == "swing":
        beam.reset(request, 0.0)
        reply = {"states": beam.swing(request["steps"], request["every"])}
    elif op == "force":
        passive, kinematics = beam.force(request["repeats"])
        reply = {"passive_seconds": passive, "kinematics_seconds": kinematics}
    else:
        raise ValueError(f"unknown request {op!r}")
    if not np.isfinite(beam.data.qpos).all():
        raise FloatingPointError("the state is not finite")
    reply["warnings"] = list(warnings)
    return reply


def main():
    warnings = []
    mujoco.set_mju_user_warning(lambda text: warnings.append(str(text)))
    for line in sys.stdin:
        warnings.clear()
        try:
            reply = answer(json.loads(line), warnings)
        except Exception as error:  # the caller prints it beside the row that is missing
            reply = {"error": f"{type(error).__name__}: {error}"}
        print(json.dumps(reply), flush=True)


if __name__ == "__main__":
    main()
