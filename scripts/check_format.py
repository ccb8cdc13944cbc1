#!/usr/bin/python3
"""Check that every C++ source is formatted as .clang-format says; --fix formats those that are not.

    scripts/check_format.py
    scripts/check_format.py --fix
"""
import argparse
import shutil
import subprocess
import sys
from pathlib import Path

ROOT = Path(__file__).resolve().parent.parent
FOLDERS = ("common", "fluid_pfem", "solid_fe", "coupler", "tests")
SKIPPED = 77  # CTest's SKIP_RETURN_CODE of this test


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--fix", action="store_true", help="format in place")
    arguments = parser.parse_args()
    program = shutil.which("clang-format")
    if not program:
        print("clang-format is not installed; nothing checked")
        return SKIPPED
    files = sorted(str(p) for folder in FOLDERS for p in (ROOT / folder).rglob("*") if p.suffix in (".cpp", ".hpp"))
    unformatted = []
    for file in files:
        before = Path(file).read_bytes()
        after = subprocess.run([program, "--style=file", file], check=True, capture_output=True).stdout
        if before != after:
            unformatted.append(str(Path(file).relative_to(ROOT)))
            if arguments.fix:
                Path(file).write_bytes(after)
    if unformatted:
        print(("formatted:" if arguments.fix else "not formatted (scripts/check_format.py --fix does it):"), *unformatted, sep="\n  ")
    return 1 if unformatted and not arguments.fix else 0


if __name__ == "__main__":
    sys.exit(main())
