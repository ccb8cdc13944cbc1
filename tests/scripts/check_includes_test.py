#!/usr/bin/python3
"""scripts/check_includes.py finds each kind of broken rule, and nothing in a clean tree."""
import sys
import tempfile
import unittest
from pathlib import Path

sys.path.insert(0, str(Path(__file__).resolve().parents[2] / "scripts"))
from check_includes import check_tree  # noqa: E402

CLEAN = {
    "common/error.hpp": "// Errors.\n#pragma once\n",
    "common/coupling/wire.hpp": "// Bytes.\n// SPDX-License-Identifier: BSD-3-Clause\n#pragma once\n#include <mpi.h>\n",
    "fluid_pfem/remesh/delaunay_2d.cpp": "// Delaunay.\n#include <CGAL/Delaunay_triangulation_2.h>\n",
    "solid_fe/solid.hpp": '// The solid.\n#pragma once\n#include "common/error.hpp"\n',
    "tests/solid_fe/solid_test.cpp": '// Claims.\n#include "solid_fe/solid.hpp"\n#include "tests/solid_fe/fixtures.hpp"\n',
    "tests/solid_fe/fixtures.hpp": "// Fixtures.\n#pragma once\n",
    "tests/coupled/all_test.cpp": '// Everything.\n#include "solid_fe/solid.hpp"\n#include "fluid_pfem/fluid.hpp"\n',
    "fluid_pfem/fluid.hpp": "// The fluid.\n#pragma once\n",
}


def complaints_with(**changes):
    """Complaints about the clean tree with some files replaced; '__' in a name stands for '/', '_dot_' for '.'."""
    with tempfile.TemporaryDirectory() as folder:
        files = dict(CLEAN)
        files.update({name.replace("__", "/").replace("_dot_", "."): text for name, text in changes.items()})
        for name, text in files.items():
            path = Path(folder) / name
            path.parent.mkdir(parents=True, exist_ok=True)
            path.write_text(text)
        return check_tree(Path(folder))


class CheckIncludes(unittest.TestCase):
    def expect(self, place, word, **changes):
        found = complaints_with(**changes)
        self.assertEqual(len(found), 1, found)
        self.assertTrue(found[0].startswith(place), found)
        self.assertIn(word, found[0])

    def test_a_clean_tree_has_no_complaints(self):
        self.assertEqual(complaints_with(), [])

    def test_a_program_must_not_include_another(self):
        self.expect("coupler/run.cpp:2", "may include only", coupler__run_dot_cpp='// Run.\n#include "fluid_pfem/fluid.hpp"\n')

    def test_common_must_not_include_a_program(self):
        self.expect("common/io.cpp:2", "may include only", common__io_dot_cpp='// Io.\n#include "solid_fe/solid.hpp"\n')

    def test_the_protocol_library_must_not_include_the_rest_of_common(self):
        self.expect("common/coupling/link.cpp:3", "may include only",
                    common__coupling__link_dot_cpp='// Link.\n// SPDX-License-Identifier: BSD-3-Clause\n#include "common/error.hpp"\n')

    def test_tests_of_one_program_must_not_include_another(self):
        self.expect("tests/coupler/a.cpp:2", "may include only", tests__coupler__a_dot_cpp='// A.\n#include "fluid_pfem/fluid.hpp"\n')

    def test_cgal_stays_in_the_delaunay_files(self):
        self.expect("fluid_pfem/fluid.cpp:2", "CGAL", fluid_pfem__fluid_dot_cpp="// Fluid.\n#  include <CGAL/Kernel.h>\n")

    def test_toml_stays_in_the_reader_of_the_case(self):
        self.expect("solid_fe/read.cpp:2", "toml", solid_fe__read_dot_cpp="// Read.\n#include <toml.hpp>\n")

    def test_mpi_stays_out_of_the_numerics(self):
        self.expect("solid_fe/force.cpp:2", "mpi.h", solid_fe__force_dot_cpp="// Force.\n#include <mpi.h>\n")

    def test_a_relative_include_is_not_from_the_root(self):
        self.expect("solid_fe/a.cpp:2", "from the root", solid_fe__a_dot_cpp='// A.\n#include "solid.hpp"\n')

    def test_the_first_line_says_what_the_file_holds(self):
        self.expect("solid_fe/a.cpp:1", "first line", solid_fe__a_dot_cpp="#include <vector>\n")

    def test_the_protocol_library_says_its_licence(self):
        self.expect("common/coupling/a.cpp:1", "SPDX", common__coupling__a_dot_cpp="// A.\n")

    def test_a_header_is_included_once(self):
        self.expect("solid_fe/a.hpp:1", "pragma once", solid_fe__a_dot_hpp="// A.\n")

    def test_an_empty_tree_is_a_mistake(self):
        with tempfile.TemporaryDirectory() as folder:
            self.assertEqual(len(check_tree(Path(folder))), 1)


if __name__ == "__main__":
    unittest.main()
