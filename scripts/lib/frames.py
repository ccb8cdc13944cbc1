"""Field frames of a run: fluid.h5 and one file per solid, read frame by frame, also while the run goes on or after a kill."""
from dataclasses import dataclass

import h5py
import numpy as np

# XDMF's numbers of the cell types, and how many nodes each has.
TRIANGLE, QUADRILATERAL, TETRAHEDRON, HEXAHEDRON, POLYLINE = 4, 5, 6, 9, 2
NODES = {TRIANGLE: 3, QUADRILATERAL: 4, TETRAHEDRON: 4, HEXAHEDRON: 8, POLYLINE: 2}
FACES = {TETRAHEDRON: [[0, 2, 1], [0, 1, 3], [1, 2, 3], [0, 3, 2]],
         HEXAHEDRON: [[0, 3, 2, 1], [4, 5, 6, 7], [0, 1, 5, 4], [1, 2, 6, 5], [2, 3, 7, 6], [3, 0, 4, 7]]}


@dataclass
class Frame:
    time: float      # s
    points: object   # (n, 3) m
    cells: list      # of (type, (m, nodes) indices, (m,) numbers of the cells in the file)
    fields: dict     # name: (n,) or (n, k) on nodes, or on cells in the order of the file
    units: dict      # name: text

    @property
    def dim(self):
        return 3 if any(kind in FACES for kind, _, _ in self.cells) else 2

    def scalar(self, name):
        """A field as one number per node or cell: the length of vectors."""
        values = self.fields[name]
        return np.linalg.norm(values, axis=1) if values.ndim == 2 else values

    def on_nodes(self, name):
        """A scalar field on the nodes; what is known on cells is averaged."""
        values = self.scalar(name)
        if len(values) == len(self.points):
            return values
        total, count = np.zeros(len(self.points)), np.zeros(len(self.points))
        for _, nodes, number in self.cells:
            for k in range(nodes.shape[1]):
                np.add.at(total, nodes[:, k], values[number])
                np.add.at(count, nodes[:, k], 1.0)
        return total / np.maximum(count, 1.0)

    def triangles(self):
        """(m, 3) corners of what is seen: in the plane the cells, in space the faces that belong to one cell only, outward."""
        found = []
        for kind, nodes, _ in self.cells:
            if kind == TRIANGLE:
                found.append(nodes)
            elif kind == QUADRILATERAL:
                found += [nodes[:, [0, 1, 2]], nodes[:, [0, 2, 3]]]
            elif kind in FACES:
                faces = np.concatenate([nodes[:, face] for face in FACES[kind]])
                _, first, count = np.unique(np.sort(faces, axis=1), axis=0, return_index=True, return_counts=True)
                faces = faces[first[count == 1]]
                found += [faces] if faces.shape[1] == 3 else [faces[:, [0, 1, 2]], faces[:, [0, 2, 3]]]
        return np.concatenate(found) if found else np.zeros((0, 3), int)

    def outline(self):
        """(m, 2) ends of the edges that belong to one cell only (plane): the free surface, walls and interfaces."""
        edges = [nodes[:, [k, (k + 1) % nodes.shape[1]]] for kind, nodes, _ in self.cells if kind in (TRIANGLE, QUADRILATERAL)
                 for k in range(nodes.shape[1])]
        if not edges:
            return np.zeros((0, 2), int)
        unique, count = np.unique(np.sort(np.concatenate(edges), axis=1), axis=0, return_counts=True)
        return unique[count == 1]

    def lone_nodes(self):
        """Nodes of no cell: drops that fly."""
        used = np.zeros(len(self.points), bool)
        for _, nodes, _ in self.cells:
            used[nodes] = True
        return np.flatnonzero(~used)


class Frames:
    """The frames of one file. Those complete when it is opened; `len` of a new object sees later ones."""

    def __init__(self, path):
        self.path = path
        with h5py.File(path, "r", locking=False) as file:
            self.names = sorted(file["frames"])
            self.times = np.array([float(file["frames"][name].attrs["time"]) for name in self.names])

    def __len__(self):
        return len(self.names)

    def nearest(self, time):
        return int(np.argmin(np.abs(self.times - time)))

    def read(self, index):
        with h5py.File(self.path, "r", locking=False) as file:
            group = file["frames"][self.names[index]]
            fields = {name: group["fields"][name][:] for name in group["fields"]}
            units = {name: text_of(group["fields"][name].attrs.get("unit", "")) for name in group["fields"]}
            points = group["points"][:]
            return Frame(float(group.attrs["time"]), points, split_cells(group["cells"][:], flat=not np.any(points[:, 2])), fields, units)

    def field_range(self, name, samples=20):
        """1st and 99th percentile over the run, so that one spike does not hide the rest."""
        chosen = sorted({round(k) for k in np.linspace(0, len(self) - 1, samples)})
        sample = np.concatenate([self.read(k).scalar(name).ravel() for k in chosen])
        low, high = np.percentile(sample, [1, 99]) if len(sample) else (0.0, 1.0)
        return (float(low), float(high)) if high > low else (float(low) - 1.0, float(low) + 1.0)


def text_of(value):
    return value.decode() if isinstance(value, bytes) else str(value)


def split_cells(cells, flat):
    """Blocks of one type each, out of a table (one type) or of XDMF's mixed list of types and corners."""
    if cells.ndim == 2:
        kind = {2: POLYLINE, 3: TRIANGLE, 4: QUADRILATERAL if flat else TETRAHEDRON, 8: HEXAHEDRON}.get(cells.shape[1])
        return [(kind, cells, np.arange(len(cells)))] if len(cells) and kind else []
    blocks, place, number = {}, 0, 0
    while place < len(cells):
        kind = int(cells[place])
        place += 2 if kind == POLYLINE else 1  # a polyline says how many nodes it has
        blocks.setdefault(kind, []).append((number, cells[place:place + NODES[kind]]))
        place, number = place + NODES[kind], number + 1
    return [(kind, np.array([c for _, c in block]), np.array([n for n, _ in block])) for kind, block in blocks.items()]


def open_parts(out):
    """{"fluid": Frames, "solid": Frames} of what the folder holds, solids by name; programs that are not ours may write no frames."""
    parts = {}
    for path in sorted(out.glob("*.h5"), key=lambda path: (path.stem != "fluid", path.stem)):
        try:
            frames = Frames(path)
        except (OSError, KeyError):
            continue
        if len(frames):
            parts[path.stem] = frames
    return parts
