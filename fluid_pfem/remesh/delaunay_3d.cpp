// CGAL's space Delaunay triangulation.
#include "fluid_pfem/remesh/delaunay.hpp"

#include <CGAL/Delaunay_triangulation_3.h>
#include <CGAL/Delaunay_triangulation_cell_base_3.h>
#include <CGAL/Exact_predicates_inexact_constructions_kernel.h>
#include <CGAL/Triangulation_vertex_base_with_info_3.h>

#include <utility>

namespace undine::fluid
{

std::vector<Simplex<3>> delaunay(std::span<const Vec<3>> x)
{
  using Kernel = CGAL::Exact_predicates_inexact_constructions_kernel;
  using Structure =
      CGAL::Triangulation_data_structure_3<CGAL::Triangulation_vertex_base_with_info_3<index_t, Kernel>,
                                           CGAL::Delaunay_triangulation_cell_base_3<Kernel>>;
  using Triangulation = CGAL::Delaunay_triangulation_3<Kernel, Structure>;

  std::vector<std::pair<Kernel::Point_3, index_t>> points;
  points.reserve(x.size());
  for (std::size_t n = 0; n < x.size(); ++n)
    points.emplace_back(Kernel::Point_3(x[n][0], x[n][1], x[n][2]), static_cast<index_t>(n));
  const Triangulation triangulation(points.begin(), points.end());

  std::vector<Simplex<3>> simplices;
  simplices.reserve(triangulation.number_of_finite_cells());
  for (auto cell = triangulation.finite_cells_begin(); cell != triangulation.finite_cells_end(); ++cell)
    simplices.push_back(
        {cell->vertex(0)->info(), cell->vertex(1)->info(), cell->vertex(2)->info(), cell->vertex(3)->info()});
  return simplices;
}

} // namespace undine::fluid
