"""The coupling protocol for solvers in Python: undine_link.h through ctypes, with numpy arrays and exceptions.

SPDX-License-Identifier: BSD-3-Clause

One file, no build step; needs numpy, mpi4py and libundine_link.so (beside this file, in UNDINE_LINK_LIBRARY, or where
the loader looks). Import this module before mpi4py.MPI and call arm() first, so that an incomplete launch ends:

    import undine_link
    undine_link.arm("solid")
    link = undine_link.Link("solid", "mine 1.0")          # imports mpi4py.MPI, hand-shake
    with link:                                            # an exception inside ends all programs with its text
        setup = link.receive_setup()
        link.set_nodes(x, mass, fixed); link.add_faces("wet", faces); link.send_surface()
        link.send_report(stable_dt=dt)
        for window in link.windows():
            if window.activate:
                impulse, f = link.activate(v, a_free)
            ...
                f = link.exchange(v_free)                 # each step if window.fine, else the last one
            link.send_report(stable_dt=dt, steps=steps)
"""
import ctypes
import os
import sys
import traceback
from ctypes import POINTER, Structure, byref, c_char_p, c_double, c_int, c_int32, c_int64, c_void_p

import numpy as np

END, CHECKPOINT = -1, -2
NUMERICAL_ERROR = 10


def read_case():
    """Case and output folder of a solver that scripts/run started as `solver case.toml --out DIR [--set table.key=value ...]`:
    the tables with the values of --set in place of their own, and DIR. Other arguments are left alone."""
    import argparse
    import tomllib  # Python 3.11
    parser = argparse.ArgumentParser()
    parser.add_argument("case")
    parser.add_argument("--out", default=".")
    parser.add_argument("--set", action="append", default=[])
    arguments = parser.parse_known_args()[0]
    with open(arguments.case, "rb") as stream:
        case = tomllib.load(stream)
    for override in arguments.set:
        key, _, value = override.partition("=")
        table, _, name = key.partition(".")
        try:
            case.setdefault(table, {})[name] = tomllib.loads(f"v = {value}")["v"]
        except tomllib.TOMLDecodeError:
            case.setdefault(table, {})[name] = value
    return case, arguments.out


class Setup(Structure):
    """dim, n_interfaces, t_begin [s], t_end [s]."""
    _fields_ = [("dim", c_int32), ("n_interfaces", c_int32), ("t_begin", c_double), ("t_end", c_double)]


class Window(Structure):
    """Orders for one window; see undine_window in undine_link.h."""
    _fields_ = [("index", c_int64), ("steps", c_int64), ("t_begin", c_double), ("t_end", c_double),
                ("fine", c_int32), ("activate", c_int32), ("output", c_int32), ("last", c_int32)]

    @property
    def dt(self):
        """Length of one of the `steps` equal steps [s]."""
        return (self.t_end - self.t_begin) / self.steps


class Report(Structure):
    """State at a window end; see undine_report in undine_link.h."""
    _fields_ = [(name, c_double) for name in ("stable_dt", "kinetic_energy", "internal_energy", "external_work",
                                              "dissipated_energy", "interface_work", "mass")]
    _fields_ += [("steps", c_int64), ("surface_changed", c_int32), ("reserved", c_int32)]


class Surface(Structure):
    """Wet surface of the other participant; see undine_surface in undine_link.h."""
    _fields_ = [("n_nodes", c_int64), ("n_faces", c_int64), ("x", POINTER(c_double)), ("face_offset", POINTER(c_int32)),
                ("face_nodes", POINTER(c_int32))]


class LinkError(RuntimeError):
    """A call failed; `code` is an exit code of docs/protocol.md."""

    def __init__(self, code, text):
        super().__init__(text)
        self.code = code


class NumericalError(RuntimeError):
    """To be raised by a solver whose solution broke down: the run ends with code 10 and this text."""


def _load():
    beside = os.path.join(os.path.dirname(os.path.abspath(__file__)), "libundine_link.so")
    name = os.environ.get("UNDINE_LINK_LIBRARY") or (beside if os.path.exists(beside) else "libundine_link.so.1")
    lib = ctypes.CDLL(name, mode=ctypes.RTLD_GLOBAL)  # Open MPI's plug-ins look for the symbols of libmpi
    h, d, i32, i64 = c_void_p, POINTER(c_double), POINTER(c_int32), POINTER(c_int64)
    signatures = {
        "undine_arm": [c_char_p, c_double], "undine_open": [POINTER(h), c_char_p, c_char_p, c_double, c_double],
        "undine_comm_f": [h], "undine_receive_setup": [h, POINTER(Setup)],
        "undine_set_nodes": [h, c_int64, i64, d, d, i32], "undine_set_nodes_with_matrix": [h, c_int64, i64, d, d],
        "undine_add_faces": [h, c_char_p, c_int64, c_int32, i32], "undine_send_surface": [h],
        "undine_distribute": [h], "undine_add_faces_by_id": [h, c_char_p, c_int64, c_int32, i64],
        "undine_send_report": [h, POINTER(Report)], "undine_next_window": [h, POINTER(Window)],
        "undine_offer_checkpoints": [h], "undine_checkpoint_done": [h, c_char_p, c_char_p],
        "undine_send_kinematics": [h, d, d], "undine_receive_activation": [h, d, d],
        "undine_send_free_velocity": [h, d], "undine_receive_link_force": [h, d], "undine_exchange": [h, d, d],
        "undine_in_contact": [h], "undine_receive_surface": [h, POINTER(Surface)],
        "undine_open_contact": [POINTER(h), c_char_p, c_char_p, c_double, c_double],
        "undine_open_force_in": [POINTER(h), c_char_p, c_char_p, c_double, c_double], "undine_send_motion": [h, d, d],
        "undine_request_stop": [h, c_char_p], "undine_ping": [h],
    }
    for function, arguments in signatures.items():
        getattr(lib, function).argtypes = arguments
        getattr(lib, function).restype = c_int
    lib.undine_last_error.argtypes, lib.undine_last_error.restype = [h], c_char_p
    lib.undine_interface_name.argtypes, lib.undine_interface_name.restype = [h, c_int32], c_char_p
    for function in ("undine_restart_folder", "undine_checkpoint_folder"):
        getattr(lib, function).argtypes, getattr(lib, function).restype = [h], c_char_p
    lib.undine_wait_seconds.argtypes, lib.undine_wait_seconds.restype = [h], c_double
    lib.undine_abort.argtypes, lib.undine_abort.restype = [h, c_int, c_char_p, c_char_p], None
    lib.undine_close.argtypes, lib.undine_close.restype = [h], None
    return lib


_lib = _load()


def _pointer(array, kind):
    return None if array is None else array.ctypes.data_as(POINTER(kind))


def _array(values, dtype):
    return None if values is None else np.ascontiguousarray(values, dtype=dtype)


def arm(role, seconds=60.0):
    """Before mpi4py.MPI is imported: end with code 31 if a program of the mpirun line never calls MPI_Init."""
    _check(_lib.undine_arm(role.encode(), seconds), None)


def _check(code, handle):
    if code != 0:
        raise LinkError(code, _lib.undine_last_error(handle).decode(errors="replace"))


class Link:
    """One conversation with the coupler, on rank 0 of `comm`; the other ranks only hold `comm`, or, with
    distributed=True, all ranks take part, each with wet nodes of its own."""

    def __init__(self, role, solver, hello_seconds=60.0, stall_seconds=300.0, out_dir="", force_in=False, contact=False,
                 distributed=False):
        """force_in: level A, a code that takes forces; contact: it can exchange in the middle of its step where contact opens
        and closes, see undine_open_contact; distributed: all ranks make all calls, see undine_distribute."""
        from mpi4py import MPI  # calls MPI_Init
        self._handle, self._out_dir, self._shape = c_void_p(), out_dir, (0, 0)
        hand_shake = _lib.undine_open_force_in if force_in else _lib.undine_open_contact if contact else _lib.undine_open
        code = hand_shake(byref(self._handle), role.encode(), solver.encode(), hello_seconds, stall_seconds)
        if code != 0:
            self.abort(code, None)
        self.comm = MPI.Comm.f2py(_lib.undine_comm_f(self._handle))
        self.setup, self._write = None, None
        if distributed:
            code = _lib.undine_distribute(self._handle)
            if code != 0:
                self.abort(code, None)

    def __enter__(self):
        return self

    def __exit__(self, kind, error, trace):
        if isinstance(error, LinkError):
            self.abort(error.code, str(error))
        elif isinstance(error, NumericalError):
            self.abort(NUMERICAL_ERROR, str(error))
        elif error is not None:
            traceback.print_exception(kind, error, trace)
            self.abort(1, f"{kind.__name__}: {error}")
        self.close()

    def close(self):
        """Collective over the ranks of this program."""
        _lib.undine_close(self._handle)
        self._handle = c_void_p()

    def abort(self, code, text):
        """End all programs; text None: that of the last error."""
        sys.stdout.flush()
        _lib.undine_abort(self._handle, code, None if text is None else text.encode(), self._out_dir.encode())

    def offer_checkpoints(self, write):
        """Before receive_setup(): `write(folder)` writes the state into a file there and returns its name."""
        self._write = write
        _check(_lib.undine_offer_checkpoints(self._handle), self._handle)

    def restart_folder(self):
        """Folder of the checkpoint to continue from, after receive_setup(); None: the run begins at t_begin."""
        folder = _lib.undine_restart_folder(self._handle)
        return None if folder is None else folder.decode()

    def receive_setup(self):
        """Wait for SETUP; `setup.interfaces` has the names."""
        setup = Setup()
        _check(_lib.undine_receive_setup(self._handle, byref(setup)), self._handle)
        setup.interfaces = [_lib.undine_interface_name(self._handle, i).decode() for i in range(setup.n_interfaces)]
        self.setup = setup
        return setup

    def in_contact(self):
        """After receive_setup(): contact opens and closes, every window is one step with the exchange in its middle."""
        return _lib.undine_in_contact(self._handle) == 1

    def receive_surface(self):
        """A fluid in contact, before each send_surface(): positions (n, dim) [m], face_offset, face_nodes of the solid."""
        s = Surface()
        _check(_lib.undine_receive_surface(self._handle, byref(s)), self._handle)
        offset = np.ctypeslib.as_array(s.face_offset, (s.n_faces + 1,)).copy()
        return (np.ctypeslib.as_array(s.x, (s.n_nodes, self.setup.dim)).copy(), offset,
                np.ctypeslib.as_array(s.face_nodes, (int(offset[-1]),)).copy())

    def set_nodes(self, x, mass, fixed=None, node_id=None):
        """x (n, dim) [m], lumped mass (n) [kg], fixed (n, dim) of 0 and 1, node_id (n) global numbers."""
        x, mass = _array(x, float), _array(mass, float)
        fixed, node_id = _array(fixed, np.int32), _array(node_id, np.int64)
        n = len(mass)
        if x.shape != (n, self.setup.dim) or (fixed is not None and fixed.shape != x.shape) or (
                node_id is not None and node_id.shape != (n,)):
            raise ValueError(f"x must be (n, {self.setup.dim}), mass (n), fixed like x, node_id like mass")
        self._shape = x.shape
        _check(_lib.undine_set_nodes(self._handle, n, _pointer(node_id, c_int64), _pointer(x, c_double),
                                     _pointer(mass, c_double), _pointer(fixed, c_int32)), self._handle)

    def add_faces(self, interface, face_nodes):
        """face_nodes (n_faces, nodes_per_face), positions in x from 0, outward of this body."""
        faces = _array(face_nodes, np.int32)
        _check(_lib.undine_add_faces(self._handle, interface.encode(), faces.shape[0], faces.shape[1],
                                     _pointer(faces, c_int32)), self._handle)

    def add_faces_by_id(self, interface, node_ids):
        """Distributed: node_ids (n_faces, nodes_per_face), global numbers, for faces that have nodes of other ranks."""
        faces = _array(node_ids, np.int64)
        _check(_lib.undine_add_faces_by_id(self._handle, interface.encode(), faces.shape[0], faces.shape[1],
                                           _pointer(faces, c_int64)), self._handle)

    def send_surface(self):
        """MESH (waits for the answer), later MESH_UPDATE."""
        _check(_lib.undine_send_surface(self._handle), self._handle)

    def send_report(self, stable_dt, **values):
        """READY; `values` are other members of Report."""
        report = Report(stable_dt=stable_dt, **values)
        _check(_lib.undine_send_report(self._handle, byref(report)), self._handle)

    def windows(self):
        """The windows until the coupler says BYE."""
        while True:
            window = Window()
            code = _lib.undine_next_window(self._handle, byref(window))
            if code == END:
                return
            if code == CHECKPOINT:
                name = self._write(_lib.undine_checkpoint_folder(self._handle).decode())
                _check(_lib.undine_checkpoint_done(self._handle, name.encode(), None), self._handle)
                continue
            _check(code, self._handle)
            yield window

    def _vector(self, values, name):
        values = _array(values, float)
        if values.size != self._shape[0] * self._shape[1]:
            raise ValueError(f"{name} must be {self._shape}, is {values.shape}")
        return values

    def activate(self, v, a_free):
        """Returns impulse [N s] and link force [N]: v += impulse / m, a = a_free + force / m."""
        v, a_free = self._vector(v, "v"), self._vector(a_free, "a_free")
        impulse, force = np.empty(self._shape), np.empty(self._shape)
        _check(_lib.undine_send_kinematics(self._handle, _pointer(v, c_double), _pointer(a_free, c_double)), self._handle)
        _check(_lib.undine_receive_activation(self._handle, _pointer(impulse, c_double), _pointer(force, c_double)),
               self._handle)
        return impulse, force

    def send_free_velocity(self, v_free):
        """Starts the message; receive_link_force() waits for the answer."""
        v_free = self._vector(v_free, "v_free")
        _check(_lib.undine_send_free_velocity(self._handle, _pointer(v_free, c_double)), self._handle)

    def receive_link_force(self):
        """(n, dim) [N]"""
        force = np.empty(self._shape)
        _check(_lib.undine_receive_link_force(self._handle, _pointer(force, c_double)), self._handle)
        return force

    def exchange(self, v_free):
        """Free velocity out, link force in."""
        self.send_free_velocity(v_free)
        return self.receive_link_force()

    def send_motion(self, x, v):
        """Level A: positions [m] and velocities [m/s] at the start and at each window's end."""
        x, v = self._vector(x, "x"), self._vector(v, "v")
        _check(_lib.undine_send_motion(self._handle, _pointer(x, c_double), _pointer(v, c_double)), self._handle)

    def request_stop(self, reason):
        """Please end after this window."""
        _check(_lib.undine_request_stop(self._handle, reason.encode()), self._handle)

    def ping(self):
        """Alive, in long pieces of work."""
        _check(_lib.undine_ping(self._handle), self._handle)

    def wait_seconds(self):
        """Total time spent waiting for the coupler [s]."""
        return _lib.undine_wait_seconds(self._handle)
