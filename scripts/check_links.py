#!/usr/bin/env python3
"""Every link of the documents leads somewhere: files, headings, and the files of the tree that are named in `code`; says which case has no line in
docs/verification.md yet.

    scripts/check_links.py        prints what is broken; exit code 1 if anything is
"""
import re
import sys
from pathlib import Path

ROOT = Path(__file__).resolve().parent.parent
LINK = re.compile(r"\[[^\]]*\]\(([^)\s]+)\)")
# A path inside the tree: begins with one of its folders and ends with a file's suffix.
FOLDERS = "cases|cmake|common|coupler|docs|fluid_pfem|scripts|solid_fe|tests"
NAMED = re.compile(rf"`((?:{FOLDERS})/[\w./-]+\.(?:hpp|cpp|py|md|toml|h|txt|csv|cmake|bash|inp))`")


def anchors(path):
    """Names of the headings of a page, as GitHub and GitLab make them."""
    text = re.sub(r"^```.*?^```$", "", path.read_text(), flags=re.M | re.S)
    return {re.sub(r"[^\w\- ]", "", heading.lower()).strip().replace(" ", "-") for heading in re.findall(r"^#+ (.*)$", text, re.M)}


def broken(page):
    text = page.read_text()
    for target in LINK.findall(text):
        if re.match(r"[a-z]+:", target):
            continue  # another machine
        name, _, anchor = target.partition("#")
        path = (page.parent / name).resolve() if name else page
        if not path.exists():
            yield f"{page.relative_to(ROOT)}: ({target}): there is no such file"
        elif anchor and anchor not in anchors(path):
            yield f"{page.relative_to(ROOT)}: ({target}): {path.name} has no such heading"
    for name in NAMED.findall(text):
        if not (ROOT / name).exists() and not (page.parent / name).exists():
            yield f"{page.relative_to(ROOT)}: `{name}`: there is no such file"


def main():
    if "-h" in sys.argv or "--help" in sys.argv:
        print(f"{Path(__file__).name}: {__doc__}")
        return 0
    pages = [p for p in ROOT.rglob("*.md") if not {"build", "runs", ".git"} & set(p.relative_to(ROOT).parts)]
    found = [text for page in sorted(pages) for text in broken(page)]
    table = (ROOT / "docs" / "verification.md").read_text()
    lines = [f"note: docs/verification.md has no line for cases/{case.parent.name}" for case in sorted(ROOT.glob("cases/*/case.toml"))
              if f"(../cases/{case.parent.name}/" not in table]
    print("\n".join(lines + found) if lines + found else f"{len(pages)} pages, no broken link")
    return 1 if found else 0


if __name__ == "__main__":
    sys.exit(main())
