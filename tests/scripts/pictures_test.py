#!/usr/bin/python3
"""Frames are read as they were written, pictures show the field, and a report needs nothing beside it."""
import re
import subprocess
import sys
import tempfile
import unittest
from html.parser import HTMLParser
from pathlib import Path

import h5py
import numpy as np
from PIL import Image

ROOT = Path(__file__).resolve().parents[2]
sys.path.insert(0, str(ROOT / "scripts"))
from lib import frames, pictures, report  # noqa: E402

SQUARE = np.array([[0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0], [3, 3, 0]], float)  # the last belongs to no cell
CUBE = np.array([[x, y, z] for z in (0, 1) for y in (0, 1) for x in (0, 1)], float)


def write(path, points, cells, fields, times=(0.0, 0.5, 1.0)):
    with h5py.File(path, "w") as file:
        for k, t in enumerate(times):
            frame = file.create_group(f"frames/{k:06}")
            frame.attrs["time"] = t
            frame["points"], frame["cells"] = points.astype("f4"), np.asarray(cells, "i4")
            for name, (unit, values) in fields.items():
                frame[f"fields/{name}"] = (np.asarray(values) * t).astype("f4")
                frame[f"fields/{name}"].attrs["unit"] = unit


class Case(unittest.TestCase):
    def setUp(self):
        self._folder = tempfile.TemporaryDirectory()
        self.addCleanup(self._folder.cleanup)
        self.out = Path(self._folder.name)
        (self.out / "plots").mkdir()
        (self.out / "history").mkdir()

    def plane(self):
        write(self.out / "fluid.h5", SQUARE, [[0, 1, 2], [0, 2, 3]], {"pressure": ("Pa", [0, 1, 2, 3, 4]), "velocity": ("m/s", np.ones((5, 3)))})
        return frames.open_parts(self.out)


class Reading(Case):
    def test_a_plane_mesh_has_its_outline_and_its_lone_nodes(self):
        frame = self.plane()["fluid"].read(1)
        self.assertEqual(frame.dim, 2)
        self.assertEqual(frame.time, 0.5)
        self.assertEqual(sorted(map(tuple, frame.outline())), [(0, 1), (0, 3), (1, 2), (2, 3)])
        self.assertEqual(list(frame.lone_nodes()), [4])
        self.assertEqual(list(frame.on_nodes("pressure")), [0.0, 0.5, 1.0, 1.5, 2.0])
        self.assertAlmostEqual(frame.scalar("velocity")[0], 0.5 * np.sqrt(3.0), places=6)

    def test_mixed_cells_are_split_and_cell_fields_keep_their_order(self):
        mixed = [frames.TRIANGLE, 0, 1, 2, frames.POLYLINE, 2, 0, 4, frames.TRIANGLE, 0, 2, 3]
        write(self.out / "solid.h5", SQUARE, mixed, {"von_mises": ("Pa", [1.0, 5.0, 3.0])})
        frame = frames.open_parts(self.out)["solid"].read(2)
        self.assertEqual({kind: list(number) for kind, _, number in frame.cells}, {frames.TRIANGLE: [0, 2], frames.POLYLINE: [1]})
        self.assertEqual(list(frame.on_nodes("von_mises")), [3.0, 1.0, 2.0, 3.0, 5.0])  # node 0: mean of 1, 5, 3

    def test_the_surface_of_a_cube_points_outward(self):
        write(self.out / "solid.h5", CUBE, [[0, 1, 3, 2, 4, 5, 7, 6]], {"von_mises": ("Pa", [1.0])})
        frame = frames.open_parts(self.out)["solid"].read(1)
        corners = frame.points[frame.triangles()]
        self.assertEqual(len(corners), 12)
        normal = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
        # Divergence theorem: the sum of x·n over the closed surface is 3 volumes.
        self.assertAlmostEqual(0.5 * np.sum(corners.mean(axis=1) * normal), 3.0, places=6)

    def test_four_corners_in_space_are_a_tetrahedron(self):
        write(self.out / "fluid.h5", CUBE[[0, 1, 2, 4]], [[0, 1, 2, 3]], {"pressure": ("Pa", [0, 1, 2, 3])})
        frame = frames.open_parts(self.out)["fluid"].read(0)
        self.assertEqual(frame.dim, 3)
        self.assertEqual(len(frame.triangles()), 4)

    def test_a_file_that_is_being_made_is_no_part_yet(self):
        (self.out / "fluid.h5").write_bytes(b"")
        self.assertEqual(frames.open_parts(self.out), {})


class Drawing(Case):
    def test_colour_follows_the_field_in_the_plane(self):
        parts = self.plane()
        picture = pictures.Picture(parts, ranges={"fluid": (0.0, 3.0)}, window=(0.0, 1.0, 0.0, 1.0))
        pictures.draw_frames(picture, self.out / "f.png", times=[1.0])
        image = np.asarray(Image.open(self.out / "f.png").convert("RGB")).astype(int)
        # The square is drawn: viridis from violet (0) at the lower left to yellow (3) at the upper left.
        self.assertTrue(np.any(np.all(np.abs(image - [68, 1, 84]) < 24, axis=2)))
        self.assertTrue(np.any(np.all(np.abs(image - [253, 231, 37]) < 24, axis=2)))

    def test_a_body_in_space_is_drawn_and_moves(self):
        write(self.out / "solid.h5", CUBE, [[0, 1, 3, 2, 4, 5, 7, 6]], {"von_mises": ("Pa", [1.0])})
        picture = pictures.Picture(frames.open_parts(self.out))
        pictures.draw_animation(picture, self.out / "a.gif")
        with Image.open(self.out / "a.gif") as image:
            self.assertEqual(image.n_frames, 3)
            grey = np.asarray(image.convert("L"))
        self.assertGreater(np.mean(grey < 128), 0.05)  # a black cube (zero stress at t = 0) covers part of it

    def test_the_plot_command_says_which_fields_there_are(self):
        self.plane()
        done = subprocess.run([ROOT / "scripts" / "plot", self.out, "--field", "presure"], capture_output=True, text=True)
        self.assertEqual(done.returncode, 1)
        self.assertIn("--field presure", done.stderr)
        self.assertIn("pressure, velocity", done.stderr)

    def test_the_plot_command_draws_a_history(self):
        (self.out / "history" / "tip.csv").write_text("# tip\nt[s],u_x[m],u_y[m]\n0,0,0\n1,1,2\n")
        done = subprocess.run([ROOT / "scripts" / "plot", self.out, "--history", "tip", "--columns", "u_y"], capture_output=True, text=True)
        self.assertEqual(done.returncode, 0, done.stderr)
        self.assertTrue((self.out / "plots" / "tip.png").is_file())


class Links(HTMLParser):
    def __init__(self):
        super().__init__()
        self.sources, self.text = [], ""

    def handle_starttag(self, tag, attributes):
        self.sources += [value for name, value in attributes if name in ("src", "href")]

    def handle_data(self, data):
        self.text += data


class Report(Case):
    def test_a_report_needs_nothing_beside_it_and_has_every_part(self):
        self.plane()
        pictures.draw_frames(pictures.Picture(frames.open_parts(self.out)), self.out / "plots" / "frames.png")
        (self.out / "history" / "energy.csv").write_text("t[s],total[J]\n0,1\n1,2\n")
        summary = {"status": "completed", "t_end": 1.0, "wall_s": 2.0, "windows": 3, "substeps": 4, "conservation": {"mass_drift": 1e-13, "mass_drift_definition": "of <water>"},
                   "fluid": {"steps": 7, "wall_s": 2.0, "wait_s": 0.5, "rank_time_s": {"compute": [1.5, 0.5], "wait": [0.5, 1.5]}}, "comparisons": [{"name": "front", "measure": "relative_L2", "value": 0.01, "reference": 0.0, "error": 0.01,
                                                                                          "tolerance": 0.02, "pass": True}]}
        report.write(Path("case.toml"), {"run": {"name": "a & b"}, "fluid": {"density": 1000.0}}, self.out, summary, "mpirun ...")
        page = Links()
        page.feed((self.out / "report.html").read_text())
        self.assertEqual(len(page.sources), 1)
        self.assertTrue(all(s.startswith("data:image/") for s in page.sources))
        for part in ("a & b", "completed: t = 1 s", "3 windows of up to 4", "front", "pass", "of <water>", "waiting 25 %", "fluid, rank 1", "wait 75 %", "density", "total[J]", "mpirun"):
            self.assertIn(part, re.sub(r"\s+", " ", page.text))


if __name__ == "__main__":
    unittest.main(verbosity=1)
