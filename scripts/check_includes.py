#!/usr/bin/python3
"""Check who includes whom, first lines and licence lines of all C++ sources.

    scripts/check_includes.py            # of this repository; prints each broken rule as file:line: text, exit code 1
    scripts/check_includes.py --root DIR # of another tree (the test of this script uses it)

The rules, and why: fluid_pfem, solid_fe and coupler are separate programs, so they include only themselves and common;
common/coupling is a library of its own (BSD), so it includes only itself; CGAL (GPL, slow to compile) stays in the two
Delaunay files, toml11 in the reader of the case file, HDF5 in common/io; MPI stays out of the numerics.
"""
import argparse
import re
import sys
from fnmatch import fnmatch
from pathlib import Path

GENERATED = ("solid_fe/laws.hpp",)  # by CMake, from the list of laws in solid_fe/CMakeLists.txt
PROGRAMS = ("fluid_pfem", "solid_fe", "coupler")
SOURCES = (".cpp", ".hpp", ".inc")

# Library headers that only these files may include (in the programs and in common; tests are free).
CONFINED = [
    (r"CGAL/", ("fluid_pfem/remesh/delaunay_2d.cpp", "fluid_pfem/remesh/delaunay_3d.cpp")),
    (r"toml(\.hpp|11/)", ("common/config/toml_tree.cpp",)),
    (r"hdf5\.h", ("common/io/frames.cpp", "common/io/state_archive.cpp", "common/io/hdf5_handle.hpp")),
    (r"CLI/", ("common/config/command_line.cpp",)),
    (r"mpi\.h", ("common/coupling/*", "common/parallel/*", "common/program/*", "*/main.cpp")),
]


def allowed_folders(path):
    """Top-level folders whose headers `path` (relative to the root) may include; () means any."""
    parts = path.parts
    if parts[0] == "tests":
        if parts[1] in ("coupled", "system", "support"):
            return ()
        if parts[1] in PROGRAMS:
            return (parts[1], "common", "tests")
        return ("common", "tests")
    if parts[:2] == ("common", "coupling"):
        return ("common/coupling",)
    return tuple({parts[0], "common"})


def check_file(root, path):
    """Broken rules of one file, as (line number, text)."""
    text = (root / path).read_text(encoding="utf-8")
    lines = text.split("\n")
    if not re.match(r"// \S", lines[0]):
        yield 1, "the first line must be a comment that says what the file holds"
    if path.parts[:2] == ("common", "coupling") and not any("SPDX-License-Identifier: BSD-3-Clause" in line for line in lines[:5]):
        yield 1, "files of common/coupling carry '// SPDX-License-Identifier: BSD-3-Clause' below their first line"
    if path.suffix == ".hpp" and "#pragma once" not in lines:
        yield 1, "a header needs '#pragma once'"
    allowed = allowed_folders(path)
    for number, line in enumerate(lines, start=1):
        found = re.match(r'\s*#\s*include\s*([<"])([^>"]+)[>"]', line)
        if not found:
            continue
        quoted, name = found[1] == '"', found[2]
        if quoted:
            own = path.parent / name
            if name in GENERATED:
                continue
            if not (root / name).is_file():
                yield number, (f'"{name}": write ours from the root' + (f' ("{own}")' if (root / own).is_file() else ", libraries in <>"))
            elif allowed and not any(name.startswith(folder + "/") for folder in allowed):
                yield number, f'"{name}": {path.parts[0]} may include only {" and ".join(sorted(allowed))}'
        elif path.parts[0] != "tests":
            for pattern, files in CONFINED:
                if re.match(pattern, name) and not any(fnmatch(path.as_posix(), file) for file in files):
                    yield number, f"<{name}> belongs into {' and '.join(files)} only"


def check_tree(root):
    """All broken rules below `root`, as text lines."""
    complaints = []
    folders = [root / name for name in (*PROGRAMS, "common", "tests")]
    files = sorted(p for folder in folders if folder.is_dir() for p in folder.rglob("*") if p.suffix in SOURCES)
    if not files:
        complaints.append(f"{root}: no C++ sources here")
    for file in files:
        path = file.relative_to(root)
        complaints += [f"{path}:{number}: {text}" for number, text in check_file(root, path)]
    return complaints


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--root", type=Path, default=Path(__file__).resolve().parent.parent, help="top folder of the tree")
    complaints = check_tree(parser.parse_args().root)
    print("\n".join(complaints), end="\n" if complaints else "")
    return 1 if complaints else 0


if __name__ == "__main__":
    sys.exit(main())
