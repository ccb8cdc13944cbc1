#!/usr/bin/env python3
"""The law of docs/new_law.md works as it stands there.

    new_law_test.py COMPILER [FLAG ...]     its element loops compile, in all elements
    new_law_test.py --build                 in a copy of the tree: built, tests of the laws, a case (minutes)
"""
import os
import re
import subprocess
import sys
import tempfile
from pathlib import Path

ROOT = Path(__file__).resolve().parent.parent.parent
PAGE = (ROOT / "docs" / "new_law.md").read_text()
LAW = re.search(r"```cpp\n(.*?)```", PAGE, re.S).group(1)
LINE = re.search(r"```cmake\n(.*?)```", PAGE, re.S).group(1)


def run(command, **options):
    done = subprocess.run(command, capture_output=True, text=True, **options)
    if done.returncode:
        sys.exit(f"{command}\n{done.stdout[-4000:]}\n{done.stderr[-4000:]}")
    return done.stdout


def compile_only(compiler):
    with tempfile.TemporaryDirectory() as folder:
        Path(folder, "yeoh.hpp").write_text(LAW)
        Path(folder, "yeoh.cpp").write_text('#include "yeoh.hpp"\n#include "solid_fe/kernels/element_kernels.hpp"\nnamespace undine::solid\n{\n'
                                            "UNDINE_INSTANTIATE_LAW_IN(2, Yeoh)\nUNDINE_INSTANTIATE_LAW_IN(3, Yeoh)\n}\n")
        run([*compiler, "-std=c++20", "-Wall", "-Wextra", "-Wno-psabi", "-Werror", "-fsyntax-only", "-I", folder, "-I", str(ROOT), str(Path(folder, "yeoh.cpp"))])


def build():
    with tempfile.TemporaryDirectory() as folder:
        tree = Path(folder, "undine")
        for name in run(["git", "ls-files"], cwd=ROOT).splitlines():
            if (ROOT / name).is_file():
                (tree / name).parent.mkdir(parents=True, exist_ok=True)
                (tree / name).write_bytes((ROOT / name).read_bytes())
                (tree / name).chmod((ROOT / name).stat().st_mode)
        (tree / "solid_fe/materials/yeoh.hpp").write_text(LAW)
        lists = tree / "solid_fe/CMakeLists.txt"
        lists.write_text(lists.read_text().replace("    johnson_cook JohnsonCook\n", "    johnson_cook JohnsonCook\n" + LINE))
        binary = Path(folder, "build")
        run(["cmake", "-S", str(tree), "-B", str(binary), "-G", "Ninja", "-DCMAKE_BUILD_TYPE=Release", "-DCMAKE_CXX_FLAGS_RELEASE=-O1"])
        run(["cmake", "--build", str(binary), "-j", str(os.cpu_count()), "--target", "test_solid_unit", "solid_fe"])
        tests = next(binary.rglob("test_solid_unit"))
        for name in ("the first Piola stress*", "energy and stress*", "a rigid rotation gives no stress*", "all laws agree*", "the wave modulus*", "the tangent bound*",
                     "plane strain is the 3-D law*"):
            print(run([str(tests), name]).strip().splitlines()[-1])
        case = ["--set", 'solid.law="yeoh"', "--set", "solid.yeoh_stiffening=0.5", "--set", "run.t_end=0.1", "--out", str(Path(folder, "out"))]
        run([str(binary / "bin/solid_fe"), str(ROOT / "cases/elastica/case.toml"), *case])
        wrong = subprocess.run([str(binary / "bin/solid_fe"), str(ROOT / "cases/elastica/case.toml"), "--set", 'solid.law="yeo"', "--check"], capture_output=True, text=True)
        assert wrong.returncode == 2 and 'did you mean "yeoh"' in wrong.stdout + wrong.stderr, wrong.stderr
        print("a case ran with the new law; a typing mistake is told its name")


if __name__ == "__main__":
    build() if sys.argv[1:] == ["--build"] else compile_only(sys.argv[1:])
