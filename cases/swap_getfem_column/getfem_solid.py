#!/usr/bin/python3
"""GetFEM (Debian python3-getfem) as the solid of a coupled run: explicit, lumped mass, link forces at its own step where the
interface stays, in the middle of the common step where contact opens and closes.

Started by scripts/run as: getfem_solid.py case.toml --out DIR [--set table.key=value]
Reads the box, the material, the mesh size, the fixed sides and the wet sides that solid_fe would read.
"""
import sys

import undine_link

undine_link.arm("solid")

import getfem as gf  # noqa: E402
import numpy as np  # noqa: E402

gf.util_trace_level(0)
gf.util_warning_level(0)

# (P : grad of the test function, strain energy). "neo_hookean_ln": P = mu (F - F^-T) + lambda ln J F^-T and
# W = mu/2 (tr F^T F - 2) - mu ln J + lambda/2 (ln J)^2; plane strain needs no more, since F_33 = 1
F = "(Id(2)+Grad_u)"
LAW = {
    "neo_hookean_ln": (f"(mu*{F} + (lambda*log(Det({F})) - mu)*Inv({F})'):Grad_Test_u",
                       f"0.5*mu*(Norm_sqr({F}) - 2) - mu*log(Det({F})) + 0.5*lambda*sqr(log(Det({F})))"),
    "linear": ("(mu*(Grad_u + Grad_u') + lambda*Div_u*Id(2)):Grad_Test_u",
               "0.25*mu*Norm_sqr(Grad_u + Grad_u') + 0.5*lambda*sqr(Div_u)"),
}
SAFETY = 0.8  # of the stable step at rest; 5 % of compression stiffens the column and costs about 10 % of it


def list_of(value):
    return value if isinstance(value, list) else [value]


class Body:
    """A box of Q4 elements in GetFEM; unknowns as rows of (x, y) per node."""

    def __init__(self, case):
        solid, run = case["solid"], case["run"]
        h = run["characteristic_length"] / run["resolution"] * solid.get("size_factor", 1.0)
        self.origin, self.size = np.array(solid["origin"]), np.array([solid["width"], solid["height"]])
        lines = [np.linspace(o, o + s, max(1, round(s / h)) + 1) for o, s in zip(self.origin, self.size)]
        E, nu = solid["youngs_modulus"], solid["poisson_ratio"]
        force, self.energy_density = LAW[solid["law"]]
        self.mesh = gf.Mesh("cartesian", *lines)
        self.mf = gf.MeshFem(self.mesh, 2)
        self.mf.set_fem(gf.Fem("FEM_QK(2,1)"))
        self.mim = gf.MeshIm(self.mesh, gf.Integ("IM_GAUSS_PARALLELEPIPED(2,3)"))  # 2 x 2 points
        self.x = self.mf.basic_dof_nodes()[:, ::2].T.copy()
        self.u = np.zeros_like(self.x)

        self.model = gf.Model("real")
        self.model.add_fem_variable("u", self.mf)
        self.model.add_initialized_data("mu", E / (2 * (1 + nu)))
        self.model.add_initialized_data("lambda", E * nu / ((1 + nu) * (1 - 2 * nu)))
        self.model.add_nonlinear_term(self.mim, force)

        consistent = gf.asm_mass_matrix(self.mim, self.mf)
        ones = np.zeros(self.x.size)
        ones[::2] = 1.0
        self.mass = solid["density"] * consistent.mult(ones)[::2]  # row sums
        self.gravity = np.array(solid["gravity"])
        low, high = self.x <= self.origin + 1e-9, self.x >= self.origin + self.size - 1e-9
        self.sides = {"left": low[:, 0], "right": high[:, 0], "bottom": low[:, 1], "top": high[:, 1]}
        self.free = np.ones_like(self.x)
        for fix in solid["fix"]:
            for component in fix["components"]:
                self.free[self.sides[fix["on"]], "xy".index(component)] = 0.0
        wet = np.zeros(len(self.x), dtype=bool)
        for interface in case["interface"]:
            for side in list_of(interface["solid"]):
                wet |= self.sides[side]
        self.wet = np.flatnonzero(wet)

    def faces(self, side):
        """Edges of a side as positions in `wet`; the body lies to the left when one walks along them."""
        along = self.x[self.wet, 0 if side in ("top", "bottom") else 1]
        nodes = np.flatnonzero(self.sides[side][self.wet])
        nodes = nodes[np.argsort(along[nodes])]
        if side in ("top", "left"):
            nodes = nodes[::-1]
        return np.stack([nodes[:-1], nodes[1:]], axis=1)

    def internal_force(self):
        self.model.set_variable("u", self.u.ravel())
        self.model.assembly("build_rhs")
        return -self.model.rhs().reshape(self.u.shape)

    def strain_energy(self):
        self.model.set_variable("u", self.u.ravel())
        return float(gf.asm_generic(self.mim, 0, self.energy_density, -1, self.model))

    def acceleration(self):
        """M^-1 (F_ext - F_int), zero where a component is fixed."""
        return self.free * (self.gravity - self.internal_force() / self.mass[:, None])

    def stable_step(self):
        """2 / omega_max of the body at rest by power iteration on M^-1 K [s]."""
        self.model.set_variable("u", self.u.ravel())
        self.model.assembly("build_matrix")
        K = self.model.tangent_matrix()
        q = self.free * np.random.default_rng(1).normal(size=self.u.shape)
        for _ in range(200):
            q /= np.linalg.norm(q)
            Kq = self.free * np.reshape(K.mult(q.ravel()), q.shape) / self.mass[:, None]
            omega2, q = np.linalg.norm(Kq), Kq
        return 2.0 / np.sqrt(omega2)


class Histories:
    """history/<name>.csv of the case's probes on the solid, at the nodes nearest to their points."""

    def __init__(self, body, case, out, t_begin):
        self.body = body
        self.every, self.due = case["output"].get("history_every", 0.0), t_begin
        self.files = []
        for probe in case.get("probe", []):
            if probe["on"] == "solid":
                node = np.argmin(np.linalg.norm(body.x - probe["point"], axis=1))
                self.files.append((node, open(f"{out}/history/{probe['name']}.csv", "w", buffering=1)))
                self.files[-1][1].write("t[s],u_x[m],u_y[m],v_x[m/s],v_y[m/s]\n")

    def record(self, t, v):
        """A row when one is due."""
        if t < self.due - 1e-12:
            return
        self.due += self.every
        for node, file in self.files:
            file.write(f"{t:.9g}," + ",".join(f"{w:.12g}" for w in (*self.body.u[node], *v[node])) + "\n")


def main():
    case, out = undine_link.read_case()
    body = Body(case)
    u, mass, free, wet = body.u, body.mass[:, None], body.free, body.wet
    v, a = np.zeros_like(u), body.acceleration()
    stable_dt, steps = SAFETY * body.stable_step(), 0

    with undine_link.Link("solid", "GetFEM", out_dir=out, contact=True) as link:
        setup = link.receive_setup()
        link.set_nodes(body.x[wet], body.mass[wet], 1 - free[wet], node_id=wet)
        sides = {interface["name"]: list_of(interface["solid"]) for interface in case["interface"]}
        for name in setup.interfaces:
            for side in sides[name]:
                link.add_faces(name, body.faces(side))
        link.send_surface()

        histories = Histories(body, case, out, setup.t_begin)
        histories.record(setup.t_begin, v)
        link.send_report(stable_dt, mass=body.mass.sum())
        for window in link.windows():
            dt = window.dt
            if window.activate:
                impulse, f = link.activate(v[wet], a[wet])
                v[wet] += free[wet] * impulse / mass[wet]
                a[wet] += free[wet] * f / mass[wet]
            for j in range(1, window.steps + 1):
                v += 0.5 * dt * a
                if link.in_contact():
                    f = link.exchange(v[wet])
                    v[wet] += dt * free[wet] * f / mass[wet]
                u += dt * v
                a = body.acceleration()
                v += 0.5 * dt * a
                if not link.in_contact() and (window.fine or j == window.steps):
                    f = link.exchange(v[wet])
                    a[wet] += free[wet] * f / mass[wet]
                    v[wet] += 0.5 * dt * free[wet] * f / mass[wet]
            if not np.isfinite(u).all():
                raise undine_link.NumericalError(f"the displacements are not finite, t = {window.t_end:.6g} s")
            steps += window.steps
            histories.record(window.t_end, v)
            link.send_report(stable_dt, steps=steps, mass=body.mass.sum(), kinetic_energy=0.5 * float(np.sum(mass * v**2)),
                             internal_energy=body.strain_energy(), external_work=float(np.sum(mass * u * body.gravity)))


if __name__ == "__main__":
    sys.exit(main())
