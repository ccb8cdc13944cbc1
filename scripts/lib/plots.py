"""Plots of a run: histories over their references, ledgers, rendered frames and an animation."""
from pathlib import Path

import matplotlib

matplotlib.use("Agg")
import matplotlib.pyplot as plt  # noqa: E402

from . import compare, frames, pictures  # noqa: E402


def draw_all(case, settings, out):
    (out / "plots").mkdir(exist_ok=True)
    draw_histories(case, settings, out)
    draw_probes(settings, out)
    draw_energy(out)
    if parts := frames.open_parts(out):
        write_paraview_view(draw_pictures(parts, out / "plots", pictures.walls_of(settings)), out)


def draw_pictures(parts, folder, walls=()):
    """frames.png: pressure and von Mises stress; frames_velocity.png; animation.gif. Returns the first picture."""
    picture = pictures.Picture(parts, walls=walls)
    pictures.draw_frames(picture, folder / "frames.png")
    pictures.draw_animation(picture, folder / "animation.gif")
    if "fluid" in parts:
        pictures.draw_frames(pictures.Picture(parts, fields={"fluid": "velocity"}, window=picture.window, walls=walls), folder / "frames_velocity.png")
    return picture


def write_paraview_view(picture, out):
    """view.py: opens the run in ParaView with the fields and ranges of `picture`."""
    text = (Path(__file__).parent / "paraview_view.py").read_text()
    parts = {part: (field, *picture.ranges[part]) for part, field in picture.fields.items()}
    for name, value in (("OUT", str(out.resolve())), ("PARTS", parts), ("IN_SPACE", picture.dim == 3)):
        text = text.replace(f"@{name}@", repr(value))
    (out / "view.py").write_text(text)


def draw_probes(settings, out):
    """The histories of probes that no reference is compared with: every column over time, one axis per unit."""
    compared = {reference["history"] for reference in settings.get("reference", []) if compare.applies(reference, settings)}
    for path in sorted((out / "history").glob("*.csv")):
        if path.stem not in {probe.get("name") for probe in settings.get("probe", [])} - compared:
            continue
        table = compare.read_csv(path)
        columns = [name for name in table if name != "t[s]"]
        units = list(dict.fromkeys(name[name.index("["):] for name in columns if "[" in name))
        if not units or len(table["t[s]"]) < 2:
            continue
        figure, axes = plt.subplots(len(units), 1, figsize=(8, 1.2 + 2.6 * len(units)), constrained_layout=True, squeeze=False, sharex=True)
        for ax, unit in zip(axes[:, 0], units):
            for name in columns:
                if name.endswith(unit):
                    ax.plot(table["t[s]"], table[name], linewidth=1.2, label=name.split("[")[0])
            ax.set_ylabel(f"{path.stem} {unit}")
            ax.grid(alpha=0.3)
            ax.legend(frameon=False, ncol=6)
        axes[-1, 0].set_xlabel("t [s]")
        figure.savefig(out / "plots" / f"{path.stem}.png", dpi=110)
        plt.close(figure)


def draw_energy(out):
    """The energy ledger of the run, whichever programs wrote one."""
    ledgers = {p.stem: p for p in (out / "history").glob("*energy.csv")}
    path = next((ledgers[name] for name in ("energy", "fluid_energy", *sorted(ledgers)) if name in ledgers), None)
    if path is None:
        return
    table = compare.read_csv(path)
    if len(table["t[s]"]) < 2:
        return
    figure, ax = plt.subplots(figsize=(8, 4.2), constrained_layout=True)
    for name in table:
        if name.endswith("[J]") and table[name].any():
            ax.plot(table["t[s]"], table[name], linewidth=1.8 if name.startswith("total") else 1.0, label=name.removesuffix("[J]").replace("_", " "))
    ax.set_xlabel("t [s]")
    ax.set_ylabel("energy, cumulated work [J], per metre in the plane")
    ax.grid(alpha=0.3)
    ax.legend(frameon=False, fontsize=8, ncol=2)
    figure.savefig(out / "plots" / "energy.png", dpi=110)
    plt.close(figure)


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
            marker, colour = "os^vDP*X"[len(drawn) % 8 - 1], ("black", "tab:red", "tab:green", "tab:orange", "tab:purple")[len(drawn) % 5 - 1]
            axes.plot(t_ref[::every], y_ref[::every], marker, color=colour, markersize=4, markerfacecolor="none", label=reference.get("label", reference["value"]))
        axes.plot(t, y, color="tab:blue", linewidth=1.4, label="Undine")
        axes.set_xlabel("t [s]")
        axes.set_ylabel(f"{history}: {column.replace('[', ' [')}")
        axes.set_xlim(t[0], t[-1])
        axes.grid(alpha=0.3)
        axes.legend(loc="lower center", bbox_to_anchor=(0.5, 1.0), ncol=2, frameon=False)
        name = column.split("[")[0]
        figure.savefig(out / "plots" / f"{history}_{name}.png", dpi=130)
        plt.close(figure)
