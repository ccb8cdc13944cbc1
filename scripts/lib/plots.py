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
            axes.plot(t_ref, y_ref, "k--", linewidth=1.6, label=reference.get("label", reference["value"]))
        axes.plot(t, y, color="tab:blue", linewidth=1.2, label="Undine")
        axes.set_xlabel("t [s]")
        axes.set_ylabel(f"{history}: {column.replace('[', ' [')}")
        axes.set_xlim(t[0], t[-1])
        axes.grid(alpha=0.3)
        axes.legend()
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


def draw_frames(out, frames=(0, None, -1)):
    """Fluid pressure and von Mises stress of the solid: first, middle and last frame, side by side."""
    parts = {p: out / f"{p}.h5" for p in ("fluid", "solid")}
    parts = {p: f for p, f in parts.items() if f.is_file()}
    if not parts:
        return
    with h5py.File(next(iter(parts.values())), "r", locking=False) as file:
        n = len(file["frames"])
    chosen = sorted({k if k is not None and k >= 0 else (n - 1 if k == -1 else n // 2) for k in frames})
    figure, axes = plt.subplots(1, len(chosen), figsize=(4.2 * len(chosen), 6), constrained_layout=True, squeeze=False)
    ranges = {"fluid": value_range(parts.get("fluid"), "pressure"), "solid": value_range(parts.get("solid"), "von_mises")}
    mappable = {}
    for ax, k in zip(axes[0], chosen):
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
            ax.set_title(f"t = {time:.4g} s")
        ax.autoscale_view()
        ax.set_aspect("equal")
        ax.set_xlabel("x [m]")
        ax.set_ylabel("y [m]")
    for part, m in mappable.items():
        figure.colorbar(m, ax=axes[0].tolist(), shrink=0.6, label="fluid pressure [Pa]" if part == "fluid" else "solid von Mises stress [Pa]")
    figure.savefig(out / "plots" / "frames.png", dpi=120)
    plt.close(figure)


def value_range(path, name):
    """1st and 99th percentile over all frames, so that one spike does not hide the rest."""
    if path is None:
        return 0.0, 1.0
    with h5py.File(path, "r", locking=False) as file:
        sample = np.concatenate([file["frames"][k]["fields"][name][:].ravel() for k in sorted(file["frames"])][::max(1, len(file["frames"]) // 20)])
    low, high = np.percentile(sample, [1, 99])
    return (low, high) if high > low else (low - 1.0, low + 1.0)
