"""What `--check` finds beyond what each program checks by itself: mistakes between the programs, and advice that names the key to change.

`review` takes the settings of the case and what the programs printed; it returns the errors, the advice, and an estimate of the run.
"""
import math
import re

from .case import by_part, parts, value_of

# Upper figures per node and step, remeshing included (docs/benchmarks); an estimate, not a promise.
SECONDS_PER_NODE_STEP = {("fluid", 2): 1.5e-7, ("fluid", 3): 1.0e-6, ("solid", 2): 1.0e-7, ("solid", 3): 2.5e-7}
# Bytes of memory per node, the remesh included, and of a frame (32-bit numbers; tetrahedra in space); of a program without nodes.
MEMORY_PER_NODE = {("fluid", 2): 1.5e3, ("fluid", 3): 4e3, ("solid", 2): 1e3, ("solid", 3): 3e3}
FRAME_PER_NODE = {("fluid", 2): 56, ("fluid", 3): 120, ("solid", 2): 100, ("solid", 3): 340}
MEMORY_OF_PROGRAM, FRAME_OVERHEAD = 4e7, 4e3
SIDES = {"left": (0, 0), "right": (0, 1), "bottom": (1, 0), "top": (1, 1), "back": (2, 0), "front": (2, 1)}  # axis, end


def number(value):
    return float(value) if isinstance(value, (int, float)) and not isinstance(value, bool) else None


def facts_of(text):
    """Step [s], nodes and box [m] as a program describes itself with --check."""
    found = {}
    for key, pattern in (("step", r"(?:stable step|step +)\s*([0-9.e+-]+) s"), ("nodes", r"(\d+) nodes|nodes +(\d+)")):
        if match := re.search(pattern, text):
            found[key] = float(next(g for g in match.groups() if g))
    if match := re.search(r"box +\(([^)]*)\) to \(([^)]*)\) m", text):
        found["box"] = [[float(v) for v in corner.split(",")] for corner in match.groups()]
    return found


def review(settings, said):
    """`said`: {role: text}. Returns (errors, advice, estimate lines)."""
    solids = [role for role in parts(settings) if role != "fluid"] or ["solid"]
    settings = by_part(settings)
    facts = {program: facts_of(text) for program, text in said.items()}
    errors = [error for solid in solids for error in geometry_errors(settings, facts, solid)] + time_errors(settings, facts)
    advice = [text for solid in solids for text in unit_advice(settings, solid) + physics_advice(settings, facts, solid)]
    return errors, list(dict.fromkeys(advice)), estimate(settings, facts)


def element_size(settings, part):
    direct = number(value_of(settings, f"{part}.element_size"))
    length, resolution = number(value_of(settings, "run.characteristic_length")), number(value_of(settings, "run.resolution"))
    if direct or not (length and resolution):
        return direct
    return (number(value_of(settings, f"{part}.size_factor")) or 1.0) * length / resolution


def box_of(settings, part):
    """Corners of the built-in box of a part, or None if it has another shape."""
    table = settings.get(part, {})
    if table.get("mesh") or table.get("angle") or table.get("body") or table.get("shape", "box") != "box":
        return None
    dim = int(value_of(settings, "run.dimension") or 2)
    size = [number(table.get(key)) for key in ("width", "height", "depth")[:dim]]
    if None in size:
        return None
    origin = table.get("origin", [0.0] * dim)
    return [list(map(float, origin)), [o + s for o, s in zip(origin, size)]]


def geometry_errors(settings, facts, name):
    errors = []
    fluid, solid = box_of(settings, "fluid"), box_of(settings, name)
    h = max(element_size(settings, "fluid") or 0.0, element_size(settings, name) or 0.0)
    if fluid and solid and settings.get("interface"):
        common = [min(f1, s1) - max(f0, s0) for f0, f1, s0, s1 in zip(fluid[0], fluid[1], solid[0], solid[1])]
        if all(c > 0.5 * h for c in common):
            errors.append(f"fluid and solid overlap over {' x '.join(f'{c:.4g}' for c in common)} m: the box of the fluid reaches from {place(fluid[0])} to "
                          f"{place(fluid[1])} m, that of the solid from {place(solid[0])} to {place(solid[1])} m. Change fluid.origin, {name}.origin or the sizes (all in metres)")
        else:
            for interface in (i for i in settings["interface"] if i.get("body", name) == name):
                ends = [SIDES.get(interface.get(part)) if isinstance(interface.get(part), str) else None for part in ("fluid", "solid")]
                if all(ends) and not interface.get("separation"):
                    (axis, end), (other, other_end) = ends
                    if axis == other and axis < len(fluid[0]) and abs(fluid[end][axis] - solid[other_end][axis]) > 0.5 * h:
                        a, b = fluid[end][axis], solid[other_end][axis]
                        errors.append(f"interface \"{interface.get('name')}\": the surfaces are {abs(a - b):.4g} m apart: {'xyz'[axis]} = {a:g} m is the fluid's {interface['fluid']}, "
                                      f"{b:g} m the solid's {interface['solid']}; they must touch. Change fluid.origin or {name}.origin")
    for k, probe in enumerate(settings.get("probe", [])):
        box, point = facts.get(probe.get("on"), {}).get("box"), probe.get("point")
        if probe.get("on") == name and box and isinstance(point, list) and len(point) == len(box[0]):
            h = element_size(settings, name) or 0.0
            if any(p < low - h or p > high + h for p, low, high in zip(point, *box)):
                errors.append(f"probe[{k}].point = {point}: lies outside the solid, which reaches from {place(box[0])} to {place(box[1])} m; probe \"{probe.get('name')}\" would follow "
                              "a node far away")
    return errors


def place(point):
    return "(" + ", ".join(f"{v:g}" for v in point) + ")"


def time_errors(settings, facts):
    t_end = number(value_of(settings, "run.t_end"))
    steps = {program: f["step"] for program, f in facts.items() if f.get("step")}
    if t_end and steps and t_end < min(steps.values()):
        program = min(steps, key=steps.get)
        return [f"run.t_end = {t_end:g}: is shorter than one time step of the {program} ({steps[program]:.3g} s): nothing would happen. Is it in seconds?"]
    return []


def unit_advice(settings, solid):
    """Numbers whose size tells of other units than SI."""
    advice = []

    def doubt(key, test, text):
        value = value_of(settings, key)
        if isinstance(value, list):
            value = math.hypot(*(v for v in value if number(v) is not None))
        if number(value) is not None and test(float(value)):
            advice.append(f"{key} = {value:g}: {text}")

    real = solid not in settings or "fluid" in settings  # a solid alone may be without units, as a benchmark is
    if not real:
        return advice
    for part in ("fluid", solid):
        doubt(f"{part}.density", lambda v: 0.0 < v < 30.0, "is that g/cm3 (water: 1)? Densities are in kg/m^3 (water: 1000)")
        doubt(f"{part}.gravity", lambda v: v > 1000.0, "is that mm/s2? Accelerations are in m/s^2 (9.81)")
    doubt(f"{solid}.youngs_modulus", lambda v: v < 1e3, "is that GPa or MPa? Stresses are in Pa (rubber 1e6, steel 2.1e11)")
    doubt("fluid.bulk_modulus", lambda v: v < 1e3, "is that GPa or MPa? Stresses are in Pa (water 2.2e9)")
    doubt("fluid.viscosity", lambda v: 0.8 <= v <= 1.6 and 500.0 < (number(value_of(settings, "fluid.density")) or 0.0) < 1500.0,
          "is that mPa s (cP), as water has it at 5 to 30 degrees? Viscosities are in Pa s; water has 1e-3, glycerine 1.4")
    f, s = value_of(settings, "fluid.gravity"), value_of(settings, f"{solid}.gravity")
    if settings.get("interface") and isinstance(f, list) and isinstance(s, list) and f != s:
        advice.append(f"{solid}.gravity = {s} differs from fluid.gravity = {f}: is that wanted?")
    return advice


def sound_speed(settings):
    """(sound speed [m/s], key that sets it)."""
    c = number(value_of(settings, "fluid.sound_speed"))
    if c:
        return c, "fluid.sound_speed"
    K, rho, gamma = (number(value_of(settings, f"fluid.{key}")) for key in ("bulk_modulus", "density", "tait_exponent"))
    if not (K and rho):
        return None, ""
    return math.sqrt((gamma or 7.0) * K / rho if value_of(settings, "fluid.tait_reading") == "K" else K / rho), "fluid.bulk_modulus"


def physics_advice(settings, facts, name):
    advice = []
    fluid, solid = settings.get("fluid", {}), settings.get(name, {})
    c, key = sound_speed(settings)
    gravity = fluid.get("gravity", [])
    if c and fluid.get("height"):
        # The fastest thing to expect: the fall over the height of the fluid, or a solid that comes.
        g = max((abs(v) * float(fluid.get(side) or 0.0) for v, side in zip(gravity, ("width", "height", "depth"))), default=0.0)
        fast = max(math.sqrt(g), math.hypot(*(v for v in solid.get("initial_velocity", [0.0]) if number(v) is not None)))
        if c < 7.0 * fast:
            advice.append(f"{key} = {fluid[key.split('.')[1]]:g}: sound of {c:.4g} m/s is too slow for flow of {fast:.3g} m/s, the fluid would be compressed by "
                          f"{100.0 * min(1.0, (fast / c) ** 2):.0f} %; make it at least {10.0 * fast:.3g} m/s, ten times that speed"
                          + ("" if key == "fluid.sound_speed" else f" (or write fluid.sound_speed = {10.0 * fast:.3g})"))
    box, h = box_of(settings, name), element_size(settings, name)
    if box and h and settings.get("interface") and not solid.get("elements"):
        thin = min(b - a for a, b in zip(*box))
        if round(thin / h) < 2:
            advice.append(f"run.resolution = {value_of(settings, 'run.resolution'):g}: gives {max(1, round(thin / h))} elements over the thinnest part of the solid ({thin:.4g} m): bending needs at "
                          "least 2, better 4; raise run.resolution, lower solid.size_factor, or write solid.formulation = \"locking_free\"")
    steps = [facts.get(part, {}).get("step") for part in ("fluid", name)]
    if all(steps) and settings.get("interface"):
        ratio, most = max(steps) / min(steps), value_of(settings, "coupling.substeps_max") or 300
        fast = "fluid" if steps[0] < steps[1] else "solid"
        if ratio > most:
            advice.append(f"the steps differ by a factor of {ratio:.0f} (fluid {steps[0]:.3g} s, solid {steps[1]:.3g} s), more than the {most} sub-steps of a window: the slower side would take smaller "
                          f"steps than it could. Raise coupling.substeps_max, or slow the {fast}'s waves: "
                          + (f"{key} lower, as far as the speeds allow" if fast == "fluid" else "coarser elements of the solid (solid.size_factor)"))
    seconds = sum(cost for _, _, _, cost in costs(settings, facts))
    if seconds > 86400.0:
        advice.append(f"run.t_end = {value_of(settings, 'run.t_end'):g}: the run would take about {seconds / 86400.0:.1f} days, longer than a day; a coarser run.resolution, an earlier run.t_end, or a "
                      f"slower sound ({key or 'solid.youngs_modulus'}) shorten it" + ("; write [checkpoint] to be able to go on" if "checkpoint" not in settings else ""))
    return advice


def costs(settings, facts):
    """(program, steps, nodes, seconds of computing)."""
    t_end, dim = number(value_of(settings, "run.t_end")), int(value_of(settings, "run.dimension") or 2)
    return [(program, t_end / f["step"], f["nodes"], t_end / f["step"] * f["nodes"] * SECONDS_PER_NODE_STEP["fluid" if program == "fluid" else "solid", dim])
            for program, f in facts.items() if t_end and f.get("step") and f.get("nodes")]


def estimate(settings, facts):
    lines = [f"estimate: {program} about {steps:.0f} steps of {nodes:.0f} nodes, up to {duration(seconds)} of computing" for program, steps, nodes, seconds in costs(settings, facts)]
    known = {program: ("fluid" if program == "fluid" else "solid", int(value_of(settings, "run.dimension") or 2), f["nodes"]) for program, f in facts.items() if f.get("nodes")}
    steps = {program: f["step"] for program, f in facts.items() if f.get("step")}
    t_end = number(value_of(settings, "run.t_end"))
    if settings.get("interface") and len(steps) > 1 and t_end:
        contact = any(interface.get("separation") for interface in settings["interface"])
        fine = min(steps, key=steps.get)
        most = 1 if contact else number(value_of(settings, "coupling.substeps")) or value_of(settings, "coupling.substeps_max") or 300
        longest = min([max(steps.values()), most * steps[fine]] + [limit for limit in [number(value_of(settings, "coupling.dt_max"))] if limit])
        count = math.ceil(longest / steps[fine] * (1.0 - 1e-9))
        lines.append(f"estimate: about {math.ceil(t_end / longest)} windows of {count} " + (f"sub-steps of the {fine}" if count > 1 else "step"))
    if known:
        memory = MEMORY_OF_PROGRAM * len(facts) + sum(nodes * MEMORY_PER_NODE[part, dim] for part, dim, nodes in known.values())
        every = number(value_of(settings, "output.every"))
        frames = 0 if value_of(settings, "output.frames") is False or not (every and t_end) else int(t_end / every * (1 + 1e-9)) + 1
        size = frames * sum(FRAME_OVERHEAD + nodes * FRAME_PER_NODE[part, dim] for part, dim, nodes in known.values())
        lines.append(f"estimate: {amount(memory)} of memory, {frames} frames of {amount(size)} in all")
    return lines


def amount(size):
    for unit, name in ((1e9, "GB"), (1e6, "MB"), (1e3, "kB")):
        if size >= unit:
            return f"{size / unit:.2g} {name}" if size < 100 * unit else f"{size / unit:.0f} {name}"
    return f"{size:.0f} B"


def duration(seconds):
    for size, unit in ((86400.0, "days"), (3600.0, "hours"), (60.0, "minutes")):
        if seconds >= 2.0 * size:
            return f"{seconds / size:.0f} {unit}"
    return f"{seconds:.2g} s"
