#!/usr/bin/python3
"""Install the protocol library into a temporary folder and use it from a project that knows nothing else of Undine.

Example: install_test.py --build build/release

Builds tests/link/consumer through the CMake package and through pkg-config, shared and static, compiles the Fortran module
and loads the Python file; runs each.
"""
import argparse
import os
import subprocess
import sys
import tempfile
from pathlib import Path

HERE = Path(__file__).resolve().parent
ENVIRONMENT = dict(os.environ, OMPI_ALLOW_RUN_AS_ROOT="1", OMPI_ALLOW_RUN_AS_ROOT_CONFIRM="1")


def run(*command, **environment):
    print("$", *command, flush=True)
    done = subprocess.run([str(c) for c in command], env={**ENVIRONMENT, **environment}, text=True, stdout=subprocess.PIPE)
    print(done.stdout, end="")
    if done.returncode != 0:
        sys.exit(f"error: exit code {done.returncode}")
    return done.stdout


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--build", required=True, help="build folder of Undine")
    build = Path(parser.parse_args().build).resolve()
    with tempfile.TemporaryDirectory(prefix="undine_install_") as folder:
        prefix, work = Path(folder) / "prefix", Path(folder) / "work"
        work.mkdir()
        run("cmake", "--install", build, "--component", "link", "--prefix", prefix)
        lib = next(prefix.rglob("libundine_link.so")).parent
        loader = {"LD_LIBRARY_PATH": str(lib)}

        run("cmake", "-S", HERE / "consumer", "-B", work / "cmake", f"-DCMAKE_PREFIX_PATH={prefix}")
        run("cmake", "--build", work / "cmake")
        run(work / "cmake" / "consumer")
        run(work / "cmake" / "consumer_cpp")

        pkg = {"PKG_CONFIG_PATH": str(lib / "pkgconfig")}
        flags = run("pkg-config", "--cflags", "--libs", "undine_link", **pkg).split()
        run("mpicc", "-std=c11", "-Wall", "-Wextra", "-pedantic", "-Werror", HERE / "consumer" / "consumer.c", "-o", work / "shared", *flags)
        run(work / "shared", **loader)
        flags = run("pkg-config", "--cflags", "--libs", "--static", "undine_link", **pkg).split()
        flags = ["-l:libundine_link.a" if f == "-lundine_link" else f for f in flags]
        run("mpicc", "-std=c11", HERE / "consumer" / "consumer.c", "-o", work / "static", *flags)
        run(work / "static")

        if subprocess.run(["which", "mpif90", "gfortran"], stdout=subprocess.DEVNULL).returncode == 0:
            source = run("pkg-config", "--variable=fortran_source", "undine_link", **pkg).strip()
            run("mpif90", "-Wall", "-c", source, "-J", work, "-o", work / "undine_link.o")
        run("/usr/bin/python3", "-c", "import undine_link as u; print(u.Window(steps=4, t_begin=0, t_end=1).dt)", PYTHONPATH=str(lib))
    print("ok")


if __name__ == "__main__":
    main()
