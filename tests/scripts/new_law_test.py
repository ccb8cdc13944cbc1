#!/usr/bin/env python3
"""The law of docs/new_law.md works as it stands there.

    new_law_test.py COMPILER [FLAG ...]     its element loops compile, in all elements; at small strain it is linear elasticity
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


# Relative size of the nonlinear terms: |H| = 1e-7.
SMALL_STRAIN = """
#include "yeoh.hpp"
#include "solid_fe/materials/linear.hpp"
#include <cstdio>
using namespace undine;
template <int dim>
double worst()
{
  const solid::MaterialConfig config{.density = 1.0, .youngs_modulus = 1.0, .poisson_ratio = 0.3, .law = "yeoh"};
  const auto law = solid::Yeoh::from(config);
  const solid::Linear linear{solid::elastic_constants(1.0, 0.3)};
  Mat<dim> H;
  for (int i = 0; i < dim; ++i)
    for (int j = 0; j < dim; ++j)
      H(i, j) = 1e-7 * (i == j ? 1.0 + 0.3 * i : 0.4 - 0.7 * j);
  const auto expected = linear.first_piola(H), difference = law.first_piola(H) - expected;
  return std::sqrt(contract(difference, difference) / contract(expected, expected));
}
int main()
{
  std::printf("%.2e %.2e\\n", worst<2>(), worst<3>());
  return worst<2>() < 1e-6 && worst<3>() < 1e-6 ? 0 : 1;
}
"""


def compile_only(compiler):
    with tempfile.TemporaryDirectory() as folder:
        Path(folder, "yeoh.hpp").write_text(LAW)
        Path(folder, "yeoh.cpp").write_text('#include "yeoh.hpp"\n#include "solid_fe/kernels/element_kernels.hpp"\nnamespace undine::solid\n{\n'
                                            "UNDINE_INSTANTIATE_LAW_IN(2, Yeoh)\nUNDINE_INSTANTIATE_LAW_IN(3, Yeoh)\n}\n")
        run([*compiler, "-std=c++20", "-Wall", "-Wextra", "-Wno-psabi", "-Werror", "-fsyntax-only", "-I", folder, "-I", str(ROOT), str(Path(folder, "yeoh.cpp"))])
        Path(folder, "small.cpp").write_text(SMALL_STRAIN)
        run([*compiler, "-std=c++20", "-Wno-psabi", "-I", folder, "-I", str(ROOT), str(Path(folder, "small.cpp")), "-o", str(Path(folder, "small"))])
        print("difference from linear elasticity at small strain, plane and space:", run([str(Path(folder, "small"))]).strip())


def build():
    with tempfile.TemporaryDirectory() as folder:
        tree = Path(folder)  # no deeper: a compiler cache then knows the files that stay
        for name in run(["git", "ls-files"], cwd=ROOT).splitlines():
            if (ROOT / name).is_file():
                (tree / name).parent.mkdir(parents=True, exist_ok=True)
                (tree / name).write_bytes((ROOT / name).read_bytes())
                (tree / name).chmod((ROOT / name).stat().st_mode)
        (tree / "solid_fe/materials/yeoh.hpp").write_text(LAW)
        lists = tree / "solid_fe/CMakeLists.txt"
        lists.write_text(lists.read_text().replace("    johnson_cook JohnsonCook\n", "    johnson_cook JohnsonCook\n" + LINE))
        binary = tree / "build" / "release"
        run(["cmake", "--preset", "release"], cwd=tree)
        run(["cmake", "--build", str(binary), "-j", str(os.cpu_count()), "--target", "test_solid_laws", "solid_fe"])
        tests = next(binary.rglob("test_solid_laws"))
        for name in ("the first Piola stress*", "energy and stress*", "a rigid rotation gives no stress*", "all laws agree*", "the wave modulus*", "the tangent bound*",
                     "plane strain is the 3-D law*"):
            print(run([str(tests), name]).strip().splitlines()[-1])
        case = ["--set", 'solid.law="yeoh"', "--set", "solid.yeoh_stiffening=0.5", "--set", "run.t_end=0.1", "--out", str(tree / "out")]
        run([str(binary / "bin/solid_fe"), str(ROOT / "cases/elastica/case.toml"), *case])
        wrong = subprocess.run([str(binary / "bin/solid_fe"), str(ROOT / "cases/elastica/case.toml"), "--set", 'solid.law="yeo"', "--check"], capture_output=True, text=True)
        assert wrong.returncode == 2 and 'did you mean "yeoh"' in wrong.stdout + wrong.stderr, wrong.stderr
        print("a case ran with the new law; a typing mistake is told its name")


if __name__ == "__main__":
    build() if sys.argv[1:] == ["--build"] else compile_only(sys.argv[1:])
