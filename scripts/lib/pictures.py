"""Rendered frames and animations of a run, plane or in space, without a display.

A body in space is drawn by its surface: projected along the view, lit from the viewer, near triangles over far ones.
"""
import io

import matplotlib

matplotlib.use("Agg")
import matplotlib.pyplot as plt  # noqa: E402
import matplotlib.ticker  # noqa: E402
import numpy as np  # noqa: E402
from matplotlib.collections import LineCollection, PolyCollection  # noqa: E402
from PIL import Image  # noqa: E402

DEFAULT_FIELD = {"fluid": "pressure", "solid": "von_mises"}
COLOURS = {"pressure": "viridis", "velocity": "turbo", "density": "cividis", "von_mises": "inferno", "displacement": "magma", "plastic_strain": "magma"}
FALLBACK = ("velocity", "displacement", "pressure")  # if a program does not write the default field


PREFIXES = ((1e9, "G"), (1e6, "M"), (1e3, "k"), (1.0, ""))


def walls_of(settings):
    """Lines of the rigid walls of a plane case that do not move, as arrays (n, 2) [m]."""
    fluid = settings.get("fluid") or {}
    lines = []
    for wall in fluid.get("wall", []):
        if "displacement" in wall or "angle" in wall or int(settings.get("run", {}).get("dimension", 2)) != 2:
            continue
        points = np.reshape(wall.get("points", []), (-1, 2))
        if len(wall.get("box", [])) == 4:
            x0, y0, x1, y1 = wall["box"]
            points = np.array([[x0, y0], [x1, y0], [x1, y1], [x0, y1]])
        if len(points) > 1:
            lines.append(np.vstack([points, points[:1]]) if wall.get("closed") or "box" in wall else points)
    return lines


class Picture:
    """How a run is drawn: its parts, their fields and ranges, the window and the view, the same in every frame."""

    def __init__(self, parts, fields=None, ranges=None, view=(35.0, 20.0), window=None, walls=()):
        """`fields` and `ranges`: {"fluid": ..., "solid": ...}, what is absent is chosen; `view`: azimuth and elevation in degrees (space);
        `window`: (x0, x1, y0, y1) in m; `walls`: lines of walls_of()."""
        self.parts, self.walls = parts, walls
        self.fields, self.ranges, self.units = {}, {}, {}
        first = {part: frames.read(0) for part, frames in parts.items()}
        for part, frames in parts.items():
            known = first[part].fields
            wanted = (fields or {}).get(part)
            if wanted is not None and wanted not in known:
                if wanted in {name for frame in first.values() for name in frame.fields}:
                    wanted = None  # a field of the other part
                else:
                    raise SystemExit(f"error: --field {wanted}: {frames.path} has {', '.join(sorted(known))}")
            name = wanted or next((n for n in (DEFAULT_FIELD["fluid" if part == "fluid" else "solid"], *FALLBACK) if n in known), None)
            if name is None:
                continue
            self.fields[part], self.units[part] = name, first[part].units[name]
            self.ranges[part] = (ranges or {}).get(part) or frames.field_range(name)
        self.dim = max(frame.dim for frame in first.values())
        azimuth, elevation = np.radians(view)
        # Vertical is y; the viewer looks from azimuth about it, and from above.
        right = np.array([np.cos(azimuth), 0.0, -np.sin(azimuth)])
        toward = np.array([np.sin(azimuth) * np.cos(elevation), np.sin(elevation), np.cos(azimuth) * np.cos(elevation)])
        self.axes = np.array([right, np.cross(toward, right), toward]) if self.dim == 3 else np.eye(3)
        self.window = window or self._window()

    def _window(self):
        low, high = np.full(2, np.inf), np.full(2, -np.inf)
        for frames in self.parts.values():
            for k in sorted({round(k) for k in np.linspace(0, len(frames) - 1, 8)}):
                frame = frames.read(k)
                seen = (frame.points @ self.axes.T)[np.unique(frame.triangles()), :2]
                if len(seen):
                    low, high = np.minimum(low, seen.min(axis=0)), np.maximum(high, seen.max(axis=0))
        if not np.all(np.isfinite(low)):
            low, high = np.zeros(2), np.ones(2)
        margin = 0.02 * max(high - low)
        return low[0] - margin, high[0] + margin, low[1] - margin, high[1] + margin

    @property
    def aspect(self):
        """Width over height of the window."""
        x0, x1, y0, y1 = self.window
        return (x1 - x0) / (y1 - y0)

    def draw(self, ax, time):
        """All parts at the frame nearest to `time`. Returns {part: mappable} for colour bars and the frame's time."""
        mappables, layers = {}, []
        shown = time
        for part, frames in self.parts.items():
            if part not in self.fields:
                continue
            frame = frames.read(frames.nearest(time))
            shown = frame.time
            seen = frame.points @ self.axes.T
            triangles, values = frame.triangles(), frame.on_nodes(self.fields[part])
            layers.append((part, frame, seen, triangles, values))
            mappables[part] = matplotlib.cm.ScalarMappable(matplotlib.colors.Normalize(*self.ranges[part]), COLOURS.get(self.fields[part], "viridis"))
        draw = self._draw_space if self.dim == 3 else self._draw_plane
        draw(ax, layers, mappables)
        x0, x1, y0, y1 = self.window
        ax.set_xlim(x0, x1)
        ax.set_ylim(y0, y1)
        ax.set_aspect("equal")
        return mappables, shown

    def _draw_plane(self, ax, layers, mappables):
        for wall in self.walls:
            ax.plot(wall[:, 0], wall[:, 1], color="0.5", linewidth=1.6, zorder=0.5)
        for part, frame, seen, triangles, values in layers:
            if len(triangles):
                ax.tripcolor(seen[:, 0], seen[:, 1], triangles, values, shading="gouraud", norm=mappables[part].norm, cmap=mappables[part].cmap)
            ax.add_collection(LineCollection(seen[frame.outline()][:, :, :2], colors="midnightblue" if part == "fluid" else "black", linewidths=0.5))
            drops = frame.lone_nodes()
            ax.scatter(seen[drops, 0], seen[drops, 1], s=1.0, c=values[drops], norm=mappables[part].norm, cmap=mappables[part].cmap)

    def _draw_space(self, ax, layers, mappables):
        polygons, colours, depth = [], [], []
        for part, _, seen, triangles, values in layers:
            corners = seen[triangles]
            normal = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
            light = 0.45 + 0.55 * np.abs(normal[:, 2]) / np.maximum(np.linalg.norm(normal, axis=1), 1e-300)
            colour = mappables[part].to_rgba(values[triangles].mean(axis=1))
            colour[:, :3] *= light[:, None]
            polygons.append(corners[:, :, :2])
            colours.append(colour)
            depth.append(corners[:, :, 2].mean(axis=1))
        if polygons:
            order = np.argsort(np.concatenate(depth))
            colour = np.concatenate(colours)[order]
            ax.add_collection(PolyCollection(np.concatenate(polygons)[order], facecolors=colour, edgecolors=colour, linewidths=0.15))

    def finish(self, figure, axes, mappables):
        """Colour bars and names of the axes; pressures and stresses in Pa, kPa, MPa or GPa."""
        for part, mappable in mappables.items():
            unit = self.units[part]
            scale, prefix = next(((s, p) for s, p in PREFIXES if max(map(abs, self.ranges[part])) >= 2.0 * s), PREFIXES[-1]) if unit == "Pa" else PREFIXES[-1]
            label = f"{part}: {self.fields[part].replace('_', ' ')}" + (f" [{prefix}{unit}]" if unit else "")
            figure.colorbar(mappable, ax=axes, shrink=0.7, label=label, location="bottom" if self.aspect > 1.2 else "right", aspect=30, fraction=0.06,
                            format=matplotlib.ticker.FuncFormatter(lambda value, _, scale=scale: f"{value / scale:.6g}"))

    def times(self):
        """Times at which the part with most frames has one."""
        return max((frames.times for frames in self.parts.values()), key=len)


def draw_frames(picture, path, times=None, dpi=110):
    """Some frames side by side, wide domains below each other."""
    known = picture.times()
    wide, tall = picture.aspect > 3.0, picture.aspect < 0.8
    if times is None:
        times = known[sorted({round(k) for k in np.linspace(0, len(known) - 1, 4 if wide else 6)})]
    n = len(times)
    if not wide and not tall and n >= 3:
        shape, size = (-(-n // 3), 3), (10.0, 2.2 + -(-n // 3) * (0.7 + 3.1 / picture.aspect))
    elif wide:
        shape, size = (n, 1), (7.5, 1.3 + n * (0.35 + 7.0 / picture.aspect))
    else:
        each = max(1.1, 5.0 * picture.aspect)
        shape, size = (1, n), (min(24.0, 1.8 + n * (each + 0.25)), 6.2)
    figure, axes = plt.subplots(*shape, figsize=size, layout="compressed", squeeze=False, sharex=True, sharey=True)
    for ax in axes.flat[n:]:
        ax.set_axis_off()
    for ax, time in zip(axes.flat, times):
        mappables, shown = picture.draw(ax, time)
        ax.set_title(f"t = {shown:.3g} s", fontsize=10)
        if picture.dim == 3:
            ax.set_axis_off()
            continue
        if picture.aspect < 0.4:  # no room for more than its ends
            ax.set_xticks([float(f"{v:.3g}") for v in (picture.window[0], picture.window[1])])
        ax.label_outer()
    if picture.dim == 2:
        for ax in axes[-1]:
            ax.set_xlabel("x [m]")
        for ax in axes[:, 0]:
            ax.set_ylabel("y [m]")
    picture.finish(figure, axes.ravel().tolist(), mappables)
    figure.savefig(path, dpi=dpi, bbox_inches="tight", pad_inches=0.08)
    plt.close(figure)


def draw_animation(picture, path, times=None, most=60, seconds=6.0, dpi=80):
    """A GIF of at most `most` frames that lasts `seconds`, or whatever else matplotlib and ffmpeg write by the name's end (.mp4)."""
    known = picture.times() if times is None else np.asarray(times)
    known = known[sorted({round(k) for k in np.linspace(0, len(known) - 1, min(most, len(known)))})]
    size = (6.4, max(2.4, min(8.0, 6.4 / picture.aspect + 1.0))) if picture.aspect > 1.2 else (max(3.2, 5.6 * picture.aspect + 1.8), 5.6)
    figure, ax = plt.subplots(figsize=size, constrained_layout=True)

    def one(time):
        ax.clear()
        mappables, shown = picture.draw(ax, time)
        ax.set_title(f"t = {shown:.4f} s", fontsize=10)
        if picture.dim == 3:
            ax.set_axis_off()
        else:
            ax.set_xlabel("x [m]")
            ax.set_ylabel("y [m]")
        return mappables

    picture.finish(figure, ax, one(known[0]))
    for _ in range(2):  # the layout of the second drawing knows the labels' sizes
        figure.canvas.draw()
    figure.set_layout_engine("none")  # the frame must not jump

    if path.suffix != ".gif":
        from matplotlib import animation
        animation.FuncAnimation(figure, lambda time: one(time) and (), frames=known, interval=1000.0 * seconds / len(known)).save(path, dpi=dpi)
        plt.close(figure)
        return
    images = []
    for time in known:
        one(time)
        buffer = io.BytesIO()
        figure.savefig(buffer, dpi=dpi, format="raw")
        width, height = (int(v) for v in figure.get_size_inches() * dpi)
        images.append(Image.frombytes("RGBA", (width, height), buffer.getvalue()).convert("RGB"))
    # One palette for all frames, out of eight of them: it would flicker else.
    some = images[::max(1, len(images) // 8)]
    mosaic = Image.new("RGB", (width, len(some) * height))
    for k, image in enumerate(some):
        mosaic.paste(image, (0, k * height))
    palette = mosaic.quantize(256, method=Image.Quantize.FASTOCTREE)
    images = [image.quantize(palette=palette, dither=Image.Dither.NONE) for image in images]
    images[0].save(path, save_all=True, append_images=images[1:], duration=max(40, round(1000.0 * seconds / len(images))), loop=0, optimize=True)
    plt.close(figure)
