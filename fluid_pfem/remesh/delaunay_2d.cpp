// CGAL's plane Delaunay triangulation.
#include "fluid_pfem/remesh/delaunay.hpp"

#include <CGAL/Delaunay_triangulation_2.h>
#include <CGAL/Exact_predicates_inexact_constructions_kernel.h>
#include <CGAL/Triangulation_vertex_base_with_info_2.h>

#include <utility>

namespace undine::fluid
{

std::vector<Simplex<2>> delaunay(std::span<const Vec<2>> x)
{
  using Kernel = CGAL::Exact_predicates_inexact_constructions_kernel;
  using Structure =
      CGAL::Triangulation_data_structure_2<CGAL::Triangulation_vertex_base_with_info_2<index_t, Kernel>>;
  using Triangulation = CGAL::Delaunay_triangulation_2<Kernel, Structure>;

  std::vector<std::pair<Kernel::Point_2, index_t>> points;
  points.reserve(x.size());
  for (std::size_t n = 0; n < x.size(); ++n)
    points.emplace_back(Kernel::Point_2(x[n][0], x[n][1]), static_cast<index_t>(n));
  const Triangulation triangulation(points.begin(), points.end());

  std::vector<Simplex<2>> simplices;
  simplices.reserve(triangulation.number_of_faces());
  for (auto face = triangulation.finite_faces_begin(); face != triangulation.finite_faces_end(); ++face)
    simplices.push_back({face->vertex(0)->info(), face->vertex(1)->info(), face->vertex(2)->info()});
  return simplices;
}

} // namespace undine::fluid
