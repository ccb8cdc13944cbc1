#!/usr/bin/python3
"""FEniCSx (Debian python3-dolfinx-real) as the solid of a coupled run: explicit, lumped mass, link forces at its own step, on any
number of MPI ranks.

Started by scripts/run as: dolfinx_solid.py case.toml --out DIR [--set table.key=value]
Reads the box, the material, the mesh size and the fixed sides that solid_fe would read.
"""
import logging
import sys

import undine_link

undine_link.arm("solid")

import numpy as np  # noqa: E402

logging.disable(logging.INFO)  # the form compiler tells each file that it compiles


class Body:
    """A box of Q4 elements in dolfinx on the ranks of `comm`; vectors are rows of (x, y) per node that this rank owns."""

    def __init__(self, case, comm):
        import petsc4py
        petsc4py.init([], comm=comm)  # before dolfinx: PETSc starts with collective calls, on the whole world if it is not told
        import ufl
        from dolfinx import fem, mesh
        from mpi4py import MPI
        self.fem, self.comm, self.sum = fem, comm, MPI.SUM
        solid, run = case["solid"], case["run"]
        h = run["characteristic_length"] / run["resolution"] * solid.get("size_factor", 1.0)
        origin, size = np.array(solid["origin"]), np.array([solid["width"], solid["height"]])
        domain = mesh.create_rectangle(comm, [origin, origin + size], [max(1, round(s / h)) for s in size],
                                       mesh.CellType.quadrilateral)
        self.space = fem.VectorFunctionSpace(domain, ("Lagrange", 1))
        self.owned = self.space.dofmap.index_map.size_local
        self.x = self.space.tabulate_dof_coordinates()[:self.owned, :2].copy()
        self.displacement = fem.Function(self.space)
        u, test, dx = self.displacement, ufl.TestFunction(self.space), ufl.Measure("dx", metadata={"quadrature_degree": 3})
        E, nu = solid["youngs_modulus"], solid["poisson_ratio"]
        mu, lam = E / (2 * (1 + nu)), E * nu / ((1 + nu) * (1 - 2 * nu))
        # plane strain needs no more than two dimensions, since F_33 = 1
        F = ufl.Identity(2) + ufl.grad(u)
        J = ufl.det(F)
        if solid["law"] == "neo_hookean_ln":
            energy = mu / 2 * (ufl.inner(F, F) - 2) - mu * ufl.ln(J) + lam / 2 * ufl.ln(J)**2
        else:
            strain = ufl.sym(ufl.grad(u))
            energy = mu * ufl.inner(strain, strain) + lam / 2 * ufl.tr(strain)**2
        force = ufl.derivative(energy * dx, u, test)
        self.force_form, self.energy_form = fem.form(force), fem.form(energy * dx)
        self.direction = fem.Function(self.space)
        self.tangent_form = fem.form(ufl.derivative(force, u, self.direction))
        one = fem.Constant(domain, np.ones(2))
        self.mass = solid["density"] * self.assemble(fem.form(ufl.inner(one, test) * dx))  # row sums

        low, high = self.x <= origin + 1e-9, self.x >= origin + size - 1e-9
        self.sides = {"left": low[:, 0], "right": high[:, 0], "bottom": low[:, 1], "top": high[:, 1]}
        self.free = np.ones_like(self.x)
        for fix in solid["fix"]:
            for component in fix["components"]:
                self.free[self.sides[fix["on"]], "xy".index(component)] = 0.0
        self.gravity = np.array(solid["gravity"])
        self.u = np.zeros_like(self.x)

    def assemble(self, form):
        """Nodal vector of a linear form, summed over ranks, at the owned nodes."""
        from petsc4py import PETSc
        vector = self.fem.petsc.assemble_vector(form)
        vector.ghostUpdate(addv=PETSc.InsertMode.ADD, mode=PETSc.ScatterMode.REVERSE)
        values = vector.array.reshape(-1, 2).copy()
        vector.destroy()
        return values

    def show(self, function, values):
        """Owned values into a function, ghosts included."""
        function.x.array[:2 * self.owned] = values.ravel()
        function.x.scatter_forward()

    def acceleration(self):
        """M^-1 (F_ext - F_int), zero where a component is fixed."""
        self.show(self.displacement, self.u)
        return self.free * (self.gravity - self.assemble(self.force_form) / self.mass)

    def total(self, values):
        return self.comm.allreduce(float(np.sum(values)), self.sum)

    def strain_energy(self):
        return self.comm.allreduce(self.fem.assemble_scalar(self.energy_form), self.sum)

    def stable_step(self):
        """2 / omega_max of the body at rest by power iteration on M^-1 K [s]."""
        self.show(self.displacement, self.u)
        q = self.free * np.sin(1.0 + 1e4 * self.x[:, ::-1]**2 + 3e3 * self.x)  # all modes, the same on any ranks
        for _ in range(200):
            q /= np.sqrt(self.total(q**2))
            self.show(self.direction, q)
            q = self.free * self.assemble(self.tangent_form) / self.mass
        return 2.0 / self.total(q**2)**0.25


SAFETY = 0.8  # of the stable step at rest; 5 % of compression stiffens the column and costs about 10 % of it


class WetSurface:
    """The nodes of one side, in the order of their x on rank 0, whoever owns them."""

    def __init__(self, body, side):
        self.comm = body.comm
        self.own = np.flatnonzero(body.sides[side])
        parts = self.comm.gather((body.x[self.own], body.mass[self.own, 0], body.free[self.own]))
        if self.comm.rank == 0:
            self.counts = [len(part[0]) for part in parts]
            x, self.mass, self.free = (np.concatenate(columns) for columns in zip(*parts))
            self.order = np.argsort(x[:, 0])
            self.x, self.mass, self.free = x[self.order], self.mass[self.order], self.free[self.order]

    def collect(self, values):
        """Rows of all wet nodes on rank 0, None elsewhere."""
        parts = self.comm.gather(values[self.own])
        return np.concatenate(parts)[self.order] if self.comm.rank == 0 else None

    def spread(self, values):
        """The own rows of what rank 0 has."""
        parts = None
        if self.comm.rank == 0:
            rows = np.empty_like(values)
            rows[self.order] = values
            parts = np.split(rows, np.cumsum(self.counts)[:-1])
        return self.comm.scatter(parts)


def orders(link):
    """The windows, on all ranks: (steps, dt, t_end, fine, activate); rank 0 hears them from the coupler."""
    windows = link.windows() if link.comm.rank == 0 else None
    while True:
        w = next(windows, None) if windows else None
        order = link.comm.bcast(w and (w.steps, w.dt, w.t_end, w.fine, w.activate))
        if order is None:
            return
        yield order


def main():
    case, out = undine_link.read_case()
    with undine_link.Link("solid", "FEniCSx", out_dir=out) as link:
        lead = link.comm.rank == 0
        body = Body(case, link.comm.Dup())  # PETSc lives longer than the link
        wet = WetSurface(body, case["interface"][0]["solid"])
        u, v, a, own = body.u, np.zeros_like(body.u), body.acceleration(), wet.own
        stable_dt, steps, mass = SAFETY * body.stable_step(), 0, body.total(body.mass[:, 0])
        inverse_mass = body.free[own] / body.mass[own]

        probe = case["probe"][0]
        distance = np.linalg.norm(body.x - probe["point"], axis=1)
        nearest = min(link.comm.allgather((distance.min() if len(distance) else np.inf, link.comm.rank)))
        history = open(f"{out}/history/{probe['name']}.csv", "w", buffering=1) if nearest[1] == link.comm.rank else None

        def record(t):
            if history:
                row = (*u[np.argmin(distance)], *v[np.argmin(distance)])
                history.write(f"{t:.9g}," + ",".join(f"{w:.12g}" for w in row) + "\n")

        def report():
            energies = dict(mass=mass, kinetic_energy=0.5 * body.total(body.mass * v**2), internal_energy=body.strain_energy(),
                            external_work=body.total(body.mass * u * body.gravity))
            if lead:
                link.send_report(stable_dt, steps=steps, **energies)

        t_begin = 0.0
        if lead:
            setup = link.receive_setup()
            t_begin = setup.t_begin
            link.set_nodes(wet.x, wet.mass, 1 - wet.free)
            # the body lies to the left of a walk from right to left along its top
            link.add_faces(setup.interfaces[0], [[n + 1, n] for n in range(len(wet.x) - 1)])
            link.send_surface()
        t_begin = link.comm.bcast(t_begin)
        if history:
            history.write("t[s],u_x[m],u_y[m],v_x[m/s],v_y[m/s]\n")
        record(t_begin)
        report()
        for n_steps, dt, t_end, fine, activate in orders(link):
            if activate:
                v_wet, a_wet = wet.collect(v), wet.collect(a)
                impulse, f = link.activate(v_wet, a_wet) if lead else (None, None)
                v[own] += inverse_mass * wet.spread(impulse)
                a[own] += inverse_mass * wet.spread(f)
            for j in range(1, n_steps + 1):
                v += 0.5 * dt * a
                u += dt * v
                a = body.acceleration()
                v += 0.5 * dt * a
                if fine or j == n_steps:
                    v_wet = wet.collect(v)
                    f = wet.spread(link.exchange(v_wet) if lead else None)
                    a[own] += inverse_mass * f
                    v[own] += 0.5 * dt * inverse_mass * f
            if not np.isfinite(body.total(u**2)):
                raise undine_link.NumericalError(f"the displacements are not finite, t = {t_end:.6g} s")
            steps += n_steps
            record(t_end)
            report()
        if history:
            history.close()


if __name__ == "__main__":
    sys.exit(main())
