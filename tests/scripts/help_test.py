#!/usr/bin/python3
"""Every script and program says with --help what it is for, how it is called, and ends with 0.

Example: tests/scripts/help_test.py --build build/release
"""
import argparse
import os
import subprocess
import sys
from pathlib import Path

ROOT = Path(__file__).resolve().parents[2]
parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
parser.add_argument("--build", type=Path, default=ROOT / "build" / "release")
build = parser.parse_args().build

commands = [path for path in sorted((ROOT / "scripts").iterdir()) if path.is_file() and os.access(path, os.X_OK) and path.name != "run_case.py"]  # that is scripts/run
commands += [build / "bin" / name for name in ("coupler", "fluid_pfem", "solid_fe", "undine-conform")]
failed = 0
for command in commands:
    if not command.exists():
        print(f"{command}: not built")
        failed += 1
        continue
    environment = {**os.environ, "OMPI_ALLOW_RUN_AS_ROOT": "1", "OMPI_ALLOW_RUN_AS_ROOT_CONFIRM": "1"}
    done = subprocess.run([str(command), "--help"], capture_output=True, text=True, timeout=60, env=environment, cwd=ROOT)
    text = done.stdout + done.stderr
    missing = [word for word in (command.name,) if word not in text]
    if done.returncode or missing or len(text) < 60:
        print(f"{command.name} --help: exit code {done.returncode}, no mention of {missing}, {len(text)} characters\n{text[:400]}")
        failed += 1
print(f"{len(commands)} commands, {failed} without help")
sys.exit(1 if failed else 0)
