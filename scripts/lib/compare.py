"""Compare histories with the references that a case names in its [[reference]] tables (the keys: REFERENCE_KEYS)."""
import csv
import difflib
import sys

import numpy as np

from . import case as case_file

# name: (type, default, meaning); docs/case-file.md is made from this.
REFERENCE_KEYS = {
    "name": ("text", "required", "name of the comparison in summary.json"),
    "history": ("text", "required", "our curve: history/<history>.csv"),
    "column": ("text", "required", "column of our curve, with its unit, such as \"u_y[m]\""),
    "file": ("text", "required", "CSV file of the reference, relative to the case"),
    "time": ("text", "required", "its column of times in s"),
    "value": ("text", "required", "its column of values"),
    "measure": ("text", "required", "relative_L2: root mean square of the difference over that of the reference; "
                                    "period_of_minima: relative difference of the mean time between minima; "
                                    "final_value: relative difference of the last values; "
                                    "above, below: largest violation of our curve >= (<=) factor * reference inside `window`, over the reference; "
                                    "peak, peak_time: largest value of our curve and its time, which must lie in `band`; "
                                    "shown: only drawn, for curves that are no truth for this model"),
    "tolerance": ("number", "required", "the comparison passes if the error is at most this"),
    "band": ("2 numbers", "none", "smallest and largest acceptable peak or peak_time; the error is the distance to it over its middle"),
    "factor": ("number", "1", "factor of the reference's values"),
    "window": ("2 numbers", "all times", "times between which above, below and peaks are judged [s]"),
    "when": ("text or texts", "none", "conditions \"table.key = value\" that all must hold; else the reference is left out"),
    "label": ("text", "the value's name", "name in the legend of the plot"),
    "add": ("tables", "none", "terms added to the reference, each with file, time, value and optionally factor and when"),
}
TERM_KEYS = ("file", "time", "value", "factor", "when")


def check_references(case, settings):
    """End the script with exit code 2 at the first mistake in a [[reference]] table."""
    def stop(k, text):
        print(f"error: {case}: reference[{k}]: {text}", file=sys.stderr)
        sys.exit(2)

    for k, reference in enumerate(settings.get("reference", [])):
        for table, known in [(reference, REFERENCE_KEYS)] + [(term, TERM_KEYS) for term in reference.get("add", [])]:
            for key in table:
                if key not in known:
                    near = difflib.get_close_matches(key, known, 1)
                    stop(k, f"unknown key '{key}'" + (f": did you mean '{near[0]}'?" if near else f": known are {', '.join(known)}"))
        for key, (_, default, _) in REFERENCE_KEYS.items():
            if default == "required" and key not in reference:
                stop(k, f"missing key '{key}'")
        if reference["measure"] not in MEASURES:
            near = difflib.get_close_matches(reference["measure"], MEASURES, 1)
            stop(k, f"measure = \"{reference['measure']}\": must be one of {', '.join(MEASURES)}" + (f"; did you mean '{near[0]}'?" if near else ""))
        if not reference["column"].endswith("]"):
            stop(k, f"column = \"{reference['column']}\": must be named as in the header of history/{reference['history']}.csv, with its unit, such as \"u_y[m]\"")
        if reference["measure"].startswith("peak") and len(reference.get("band", [])) != 2:
            stop(k, f"measure = \"{reference['measure']}\" needs band = [smallest, largest]")
        for table in [reference, *reference.get("add", [])]:
            if not (case.parent / table["file"]).is_file():
                stop(k, f"file = \"{table['file']}\": there is no such file beside the case")


def read_csv(path):
    """Columns of a CSV with comment lines, as {name: array}; of a file that is being written, the finished rows."""
    with open(path, newline="") as stream:
        rows = list(csv.reader(line for line in stream if not line.startswith("#") and line.endswith("\n")))
    if not rows:
        return {}
    table = np.array([[float(x) if x else np.nan for x in row] for row in rows[1:] if len(row) == len(rows[0])]).reshape(-1, len(rows[0]))
    return {name: table[:, k] for k, name in enumerate(rows[0])}


def applies(reference, settings):
    """True if all conditions of `when` hold in the settings of this run."""
    conditions = reference.get("when", [])
    for condition in [conditions] if isinstance(conditions, str) else conditions:
        key, _, value = (part.strip() for part in condition.partition("="))
        if str(case_file.value_of(settings, key)) != value:
            return False
    return True


def interpolate(t, t_known, y_known):
    """Cubic through the four known points around each t (linear if there are fewer): references come in coarse steps."""
    if len(t_known) < 4:
        return np.interp(t, t_known, y_known)
    first = np.clip(np.searchsorted(t_known, t) - 2, 0, len(t_known) - 4)
    result = np.zeros(len(t))
    for a in range(4):
        weight = np.ones(len(t))
        for b in range(4):
            if b != a:
                weight *= (t - t_known[first + b]) / (t_known[first + a] - t_known[first + b])
        result += weight * y_known[first + a]
    return result


def reference_curve(case, reference, settings):
    table = read_csv(case.parent / reference["file"])
    t, y = table[reference["time"]], reference.get("factor", 1.0) * table[reference["value"]]
    for term in reference.get("add", []):
        if applies(term, settings):
            other = read_csv(case.parent / term["file"])
            y += term.get("factor", 1.0) * interpolate(t, other[term["time"]], other[term["value"]])
    return t, y


def our_curve(out, reference):
    table = read_csv(out / "history" / f"{reference['history']}.csv")
    return table["t[s]"], table[reference["column"]]


def minima(t, y):
    """Time of the minimum of each complete excursion below the mean: vertex of the parabola fitted to its lowest tenth.

    An excursion ends when the curve rises a tenth of its amplitude above the mean, so that ripples do not split it.
    """
    middle = np.trapz(y, t) / (t[-1] - t[0])
    depth = middle - np.min(y)
    found, start = [], None
    for k in range(len(y)):
        if start is None and y[k] < middle - 0.1 * depth:
            start = k
        elif start is not None and y[k] > middle + 0.1 * depth:
            inside = slice(start, k)
            low = np.min(y[inside])
            near = y[inside] <= low + 0.1 * (middle - low)
            if start > 0 and np.count_nonzero(near) >= 3:
                centre = t[inside][near].mean()
                a, b, _ = np.polyfit(t[inside][near] - centre, y[inside][near], 2)
                found.append(centre - b / (2.0 * a))
            start = None
    return found


def period(t, y):
    m = minima(t, y)
    return (m[-1] - m[0]) / (len(m) - 1) if len(m) > 1 else float("nan")


MEASURES = ("relative_L2", "period_of_minima", "final_value", "above", "below", "peak", "peak_time", "shown")


def measure(kind, t, y, t_ref, y_ref, band=None, window=None):
    """(value, reference value, error) of one comparison."""
    end = min(t[-1], t_ref[-1])
    if kind == "relative_L2":
        inside = (t >= t_ref[0]) & (t <= end)
        if inside.sum() < 2:
            return float("nan"), float("nan"), float("nan")
        dt = np.gradient(t[inside])
        target = interpolate(t[inside], t_ref, y_ref)
        scale = np.sqrt(np.sum(dt * target**2))
        error = np.sqrt(np.sum(dt * (y[inside] - target) ** 2)) / scale
        return error, 0.0, error
    if kind == "period_of_minima":
        keep = t_ref <= end
        value, target = period(t, y), period(t_ref[keep], y_ref[keep])
        return value, target, abs(value / target - 1.0)
    if kind == "final_value":
        value, target = np.interp(end, t, y), np.interp(end, t_ref, y_ref)
        return value, target, abs(value / target - 1.0)
    if kind in ("above", "below"):
        first, last = window or (t_ref[0], end)
        inside = (t >= first) & (t <= last)
        if t[-1] < last - 1e-9 or not inside.any():
            return float("nan"), float("nan"), float("nan")
        ratio = y[inside] / interpolate(t[inside], t_ref, y_ref)
        value = ratio.min() if kind == "above" else ratio.max()
        return value, 1.0, max(0.0, 1.0 - value if kind == "above" else value - 1.0)
    if kind in ("peak", "peak_time"):
        first, last = window or (t[0], t[-1])
        if t[-1] < last - 1e-9:
            return float("nan"), float("nan"), float("nan")
        (t, y), (t_ref, y_ref) = ((c[(c >= first) & (c <= last)], v[(c >= first) & (c <= last)]) for c, v in ((t, y), (t_ref, y_ref)))
        if not (len(t) and len(t_ref)):
            return float("nan"), float("nan"), float("nan")
        value, target = (c[np.argmax(v)] if kind == "peak_time" else np.max(v) for c, v in ((t, y), (t_ref, y_ref)))
        low, high = band
        return value, target, max(low - value, value - high, 0.0) / (0.5 * (low + high))
    raise ValueError(f"unknown measure '{kind}'; known: {', '.join(MEASURES)}")


def energy_changes_per_period(out, length):
    """(smallest, largest) change of the total energy of a coupled run over one period of `length` seconds, over the largest stored energy.

    The total of a leap-frog oscillates by O(dt^2) inside a period; so instants one period apart are compared.
    """
    energy = read_csv(out / "history" / "energy.csv")
    stored = np.maximum(energy["fluid_kinetic[J]"] + energy["solid_kinetic[J]"],
                        np.abs(energy["fluid_internal[J]"] + energy["solid_internal[J]"]))
    t, total = energy["t[s]"], energy["total[J]"]
    later = t >= length
    change = (total[later] - np.interp(t[later] - length, t, total)) / np.max(stored)
    return float(change.min()), float(change.max())


def compare_all(case, settings, out):
    results = []
    for reference in settings.get("reference", []):
        if not applies(reference, settings) or reference["measure"] == "shown":
            continue
        value, target, error = measure(reference["measure"], *our_curve(out, reference), *reference_curve(case, reference, settings),
                                       reference.get("band"), reference.get("window"))
        if not np.isfinite(error):  # a run that ends before its first period has none
            print(f"  {reference['name']:24s} {reference['measure']:18s} not measured: the run is too short for it")
            continue
        results.append({"name": reference["name"], "measure": reference["measure"], "value": value, "reference": target, "error": error,
                        "tolerance": reference["tolerance"], "pass": bool(error <= reference["tolerance"]),
                        **({"band": reference["band"]} if reference["measure"].startswith("peak") else {})})
    return results


def accepted(c):
    """What a comparison accepts, in words: the band of a peak, or the largest error."""
    if "band" not in c:
        return f"tolerance {c['tolerance']:.1e}"
    low, high = c["band"]
    return f"in {low:g} to {high:g}" + (f" or {100 * c['tolerance']:g} % beside it" if c["tolerance"] > 0 else "")


def print_table(summary, out):
    parts = [f"{summary.get('status')}: t = {summary.get('t_end') or float('nan'):.6g} s in {summary['wall_s']:.3g} s"]
    if "windows" in summary:
        parts.append(f"{summary['windows']} windows of up to {summary['substeps']} sub-steps")
    print(", ".join(parts))
    for key, value in summary.get("conservation", {}).items():
        if isinstance(value, (int, float)):
            print(f"  {key:24s} {value: .3e}")
    for c in summary["comparisons"]:
        print(f"  {c['name']:24s} {c['measure']:18s} value {c['value']:.4g}  error {c['error']:.3e}  {accepted(c)}  {'pass' if c['pass'] else 'FAIL'}")
    print(f"output: {out}")
