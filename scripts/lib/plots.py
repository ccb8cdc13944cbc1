"""Plots of a run: histories over their references, and rendered frames."""
import h5py
import matplotlib

matplotlib.use("Agg")
import matplotlib.pyplot as plt  # noqa: E402
import numpy as np  # noqa: E402
from matplotlib.collections import PolyCollection  # noqa: E402

from . import compare  # noqa: E402


def draw_all(case, settings, out):
    (out / "plots").mkdir(exist_ok=True)
    draw_histories(case, settings, out)
    draw_frames(out)


def draw_histories(case, settings, out):
    curves = {}
    for reference in settings.get("reference", []):
        if compare.applies(reference, settings):
            curves.setdefault((reference["history"], reference["column"]), []).append(reference)
    for (history, column), references in curves.items():
        figure, axes = plt.subplots(figsize=(8, 4.5), constrained_layout=True)
        t, y = compare.our_curve(out, references[0])
        drawn = set()
        for reference in references:
            key = (reference["file"], reference["value"])
            if key in drawn:
                continue
            drawn.add(key)
            t_ref, y_ref = compare.reference_curve(case, reference, settings)
            every = max(1, len(t_ref) // 60)  # as points, so that both curves are seen where they agree
            axes.plot(t_ref[::every], y_ref[::every], "o", color="black", markersize=4, markerfacecolor="none", label=reference.get("label", reference["value"]))
        axes.plot(t, y, color="tab:blue", linewidth=1.4, label="Undine")
        axes.set_xlabel("t [s]")
        axes.set_ylabel(f"{history}: {column.replace('[', ' [')}")
        axes.set_xlim(t[0], t[-1])
        axes.grid(alpha=0.3)
        axes.legend(loc="lower center", bbox_to_anchor=(0.5, 1.0), ncol=2, frameon=False)
        name = column.split("[")[0]
        figure.savefig(out / "plots" / f"{history}_{name}.png", dpi=130)
        plt.close(figure)


def frame_of(path, index):
    """Points (n, 2), list of cells, and fields of one frame of a 2-D file; None if there is none."""
    if not path.is_file():
        return None
    with h5py.File(path, "r", locking=False) as file:
        names = sorted(file["frames"])
        if not names:
            return None
        frame = file["frames"][names[index]]
        points = frame["points"][:]
        cells = [d[:] for d in frame.values() if isinstance(d, h5py.Dataset) and d.name.rsplit("/", 1)[-1].startswith("cells")]
        fields = {k: frame["fields"][k][:] for k in frame["fields"]}
        return float(frame.attrs["time"]), points, cells, fields


def draw_frames(out, columns=6):
    """Fluid pressure and von Mises stress of the solid: `columns` frames over the run, side by side, wide domains below each other."""
    parts = {p: out / f"{p}.h5" for p in ("fluid", "solid")}
    parts = {p: f for p, f in parts.items() if f.is_file()}
    if not parts:
        return
    with h5py.File(next(iter(parts.values())), "r", locking=False) as file:
        n = len(file["frames"])
    low, high = extent(parts)
    width, height = np.maximum(high - low, 1e-12)
    wide = width > 1.5 * height
    chosen = sorted({round(k) for k in np.linspace(0, n - 1, 4 if wide else columns)})
    size = (9, 0.9 + len(chosen) * min(3.5, 1.0 + 7.0 * height / width)) if wide else (1.8 + len(chosen) * max(1.3, 0.8 + 5.5 * width / height), 6.5)
    shape = (len(chosen), 1) if wide else (1, len(chosen))
    figure, axes = plt.subplots(*shape, figsize=size, constrained_layout=True, squeeze=False, sharex=True, sharey=True)
    ranges = {"fluid": value_range(parts.get("fluid"), "pressure"), "solid": value_range(parts.get("solid"), "von_mises")}
    mappable = {}
    for ax, k in zip(axes.flat, chosen):
        for part, path in parts.items():
            data = frame_of(path, k)
            if data is None or np.ptp(data[1][:, 2]) > 0.0:
                continue
            time, points, cells, fields = data
            name = "pressure" if part == "fluid" else "von_mises"
            offset = 0
            for block in cells:
                values = fields[name]
                values = values[block].mean(axis=1) if len(values) == len(points) else values[offset:offset + len(block)]
                offset += len(block)
                collection = PolyCollection(points[block][:, :, :2], array=values, cmap="viridis" if part == "fluid" else "inferno",
                                            edgecolors="face", linewidths=0.2)
                collection.set_clim(*ranges[part])
                mappable[part] = ax.add_collection(collection)
            ax.set_title(f"t = {time:.3g} s", fontsize=10)
        ax.set_xlim(low[0], high[0])
        ax.set_ylim(low[1], high[1])
        ax.set_aspect("equal")
        if width < 0.4 * height:  # no room for more than its ends
            ax.set_xticks([low[0], high[0]])
        ax.label_outer()
    for ax in axes[-1]:
        ax.set_xlabel("x [m]")
    for ax in axes[:, 0]:
        ax.set_ylabel("y [m]")
    for part, m in mappable.items():
        figure.colorbar(m, ax=axes.ravel().tolist(), shrink=0.6, label="fluid pressure [Pa]" if part == "fluid" else "solid von Mises stress [Pa]")
    figure.savefig(out / "plots" / "frames.png", dpi=120)
    plt.close(figure)


def extent(parts):
    """Lowest and highest coordinates of all parts over the first and the last frame."""
    corners = []
    for path in parts.values():
        for index in (0, -1):
            data = frame_of(path, index)
            if data is not None and len(data[1]):
                corners += [data[1][:, :2].min(axis=0), data[1][:, :2].max(axis=0)]
    return np.min(corners, axis=0), np.max(corners, axis=0)


def value_range(path, name):
    """1st and 99th percentile over all frames, so that one spike does not hide the rest."""
    if path is None:
        return 0.0, 1.0
    with h5py.File(path, "r", locking=False) as file:
        sample = np.concatenate([file["frames"][k]["fields"][name][:].ravel() for k in sorted(file["frames"])][::max(1, len(file["frames"]) // 20)])
    low, high = np.percentile(sample, [1, 99])
    return (low, high) if high > low else (low - 1.0, low + 1.0)
