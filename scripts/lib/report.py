"""report.html: one page per run that needs nothing beside it: parameters, comparisons, plots, ledgers, shares of time, pictures."""
import base64
import html
from pathlib import Path

from . import case as case_file
from . import compare

STYLE = """body{font:15px/1.5 system-ui,sans-serif;max-width:70rem;margin:2rem auto;padding:0 1rem;color:#222}h1{margin-bottom:0}h2{margin-top:2.2rem;border-bottom:1px solid #ccc}
table{border-collapse:collapse;margin:.6rem 0}td,th{padding:.15rem .8rem .15rem 0;text-align:left;vertical-align:top}th{border-bottom:1px solid #999}td.n{text-align:right;
font-variant-numeric:tabular-nums}.pass{color:#176b2c}.fail{color:#b00020;font-weight:600}img{max-width:100%;margin:.4rem 0}.bar{display:flex;height:1.3rem;width:30rem;max-width:100%}
.bar span{display:block;color:#fff;font-size:.75rem;overflow:hidden;padding-left:.2rem}code{background:#f3f3f3;padding:0 .2rem}small{color:#666}"""


def write(case, settings, out, summary, line=""):
    """Write `out`/report.html from what the run left in `out`."""
    parts = [f"<h1>{html.escape(str(settings.get('run', {}).get('name', out.name)))}</h1>", headline(summary)]
    if line:
        parts.append(f"<p><code>{html.escape(line)}</code></p>")
    if summary.get("comparisons"):
        parts += ["<h2>Against the references</h2>", comparisons(summary["comparisons"])]
    plots = sorted((out / "plots").glob("*.png"))
    parts += [image(p) for p in plots if not p.stem.startswith(("frames", "energy"))]
    moving = [p for p in (out / "plots" / "animation.gif",) if p.is_file()]
    still = [p for p in plots if p.stem.startswith("frames")]
    if moving or still:
        parts += ["<h2>Pictures</h2>", *map(image, moving + still)]
    parts += ["<h2>Ledgers</h2>", conservation(summary.get("conservation", {}))]
    parts += [image(p) for p in plots if p.stem == "energy"] + ledgers(out)
    names = ("coupler", *case_file.parts(settings))
    parts += ["<h2>Time</h2>", programs(summary, names), *(times_of_ranks(name, summary.get(name)) for name in names)]
    parts += ["<h2>Parameters</h2>", f"<p><small>{html.escape(str(case))}, overrides applied</small></p>", parameters(settings)]
    page = (f"<!DOCTYPE html><html lang=\"en\"><meta charset=\"utf-8\"><title>{html.escape(out.name)}: Undine</title><style>{STYLE}</style>"
            f"<body>{''.join(parts)}</body></html>\n")
    (out / "report.html").write_text(page)


def number(value):
    return "" if value is None else f"{value:.6g}" if isinstance(value, float) else html.escape(str(value))


def rows(head, body, numeric=()):
    cells = "".join("<tr>" + "".join(f"<td{' class=n' if k in numeric else ''}>{v}</td>" for k, v in enumerate(row)) + "</tr>" for row in body)
    return f"<table><tr>{''.join(f'<th>{h}</th>' for h in head)}</tr>{cells}</table>"


def headline(summary):
    text = f"{summary.get('status')}: t = {number(summary.get('t_end'))} s in {number(float(summary['wall_s']))} s"
    if summary.get("windows"):
        text += f", {summary['windows']} windows of up to {summary['substeps']} sub-steps"
    return f"<p class={'pass' if summary.get('status') == 'completed' else 'fail'}>{text}</p>"


def comparisons(found):
    return rows(["comparison", "measure", "value", "reference", "error", "accepted", ""],
                [[html.escape(c["name"]), c["measure"].replace("_", " "), number(c["value"]), number(c["reference"]), f"{c['error']:.2e}", compare.accepted(c),
                  "<span class=pass>pass</span>" if c["pass"] else "<span class=fail>FAIL</span>"] for c in found], numeric=(2, 3, 4, 5))


def conservation(found):
    return rows(["quantity", "value", "definition"],
                [[key.replace("_", " "), f"{value:.3e}", html.escape(str(found.get(f"{key}_definition", "")))] for key, value in found.items()
                 if isinstance(value, (int, float))], numeric=(1,))


def ledgers(out):
    """First and last row and largest magnitude of every column of the ledgers."""
    result = []
    for path in sorted((out / "history").glob("*.csv")):
        if not (path.stem in ("energy", "mass") or path.stem.endswith("_energy") or path.stem.startswith("interface_")):
            continue
        table = compare.read_csv(path)
        if not len(table.get("t[s]", ())):
            continue
        result.append(f"<details><summary>{path.stem}.csv</summary>" + rows(["column", "first", "last", "largest magnitude"], [
            [html.escape(name), number(float(v[0])), number(float(v[-1])), number(float(max(abs(v.min()), abs(v.max()))))] for name, v in table.items()],
            numeric=(1, 2, 3)) + "</details>")
    return result


def programs(summary, names):
    """One row and one bar per program: what it computed and what it waited."""
    body = []
    for name in names:
        part = summary.get(name)
        if not part:
            continue
        wall, wait = float(part.get("wall_s") or 0.0), float(part.get("wait_s") or 0.0)
        share = 0.0 if not wall else min(100.0, 100.0 * wait / wall)
        bar = bar_of((("computing", 100 - share), ("waiting", share)))
        body.append([name, number(part.get("steps")), number(part.get("nodes")), number(part.get("remeshes")), number(wall),
                     number(part.get("ns_per_node_step")), bar if wall else ""])
    return rows(["program", "steps", "nodes", "remeshes", "wall [s]", "ns/node/step", ""], body, numeric=(1, 2, 3, 4, 5))


COLOURS = {"computing": "#1f6f8b", "compute": "#1f6f8b", "halo": "#5b8c3a", "remesh": "#6a4c93", "imbalance": "#b0413e", "wait": "#c9822b", "waiting": "#c9822b"}


def bar_of(shares):
    """A bar of (word, percent)."""
    return "<div class=bar>" + "".join(f"<span style=\"width:{percent:.1f}%;background:{COLOURS[word]}\">{word} {percent:.0f} %</span>"
                                       for word, percent in shares) + "</div>"


def times_of_ranks(name, part):
    """Where the time of each rank of a program went, if there are several."""
    times = (part or {}).get("rank_time_s")
    if not times:
        return ""
    body = []
    for rank, seconds in enumerate(zip(*times.values())):
        total = sum(seconds)
        body.append([f"{name}, rank {rank}", *map(number, seconds), bar_of([(word, 100 * s / total) for word, s in zip(times, seconds)]) if total else ""])
    return rows(["", *(f"{word} [s]" for word in times), ""], body, numeric=range(1, len(times) + 1))


def parameters(settings):
    result = []
    for table, keys in settings.items():
        for k, entry in enumerate(keys if isinstance(keys, list) else [keys]):
            if table == "reference" or not isinstance(entry, dict):
                continue
            title = f"[[{table}]] {k}" if isinstance(keys, list) else f"[{table}]"
            result.append(f"<details><summary>{title}</summary>"
                          + rows(["key", "value"], [[html.escape(key), html.escape(str(value))] for key, value in entry.items()]) + "</details>")
    return "".join(result)


def image(path: Path):
    kind = {".png": "png", ".gif": "gif"}[path.suffix]
    return f"<img alt=\"{path.stem.replace('_', ' ')}\" src=\"data:image/{kind};base64,{base64.b64encode(path.read_bytes()).decode()}\">"
