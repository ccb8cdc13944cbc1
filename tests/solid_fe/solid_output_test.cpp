// Files and fields of the solid's output, and the words of its configuration.
#include "common/error.hpp"
#include "solid_fe/describe.hpp"
#include "solid_fe/run.hpp"
#include "solid_fe/solid_output.hpp"
#include "tests/solid_fe/fixtures.hpp"

#include <catch2/catch.hpp>

#include <filesystem>
#include <fstream>
#include <unistd.h>

using namespace undine;
using namespace undine::solid;
using namespace undine::solid::test;

namespace
{

/// A folder of this process that disappears with the object.
struct OutputFolder
{
  std::filesystem::path path =
      std::filesystem::temp_directory_path() / ("undine_solid_output_" + std::to_string(getpid()));
  ~OutputFolder() { std::filesystem::remove_all(path); }
};

std::vector<std::string> lines_of(const std::filesystem::path& path)
{
  std::ifstream file(path);
  REQUIRE(file);
  std::vector<std::string> lines;
  for (std::string line; std::getline(file, line);)
    lines.push_back(line);
  return lines;
}

std::vector<double> numbers_of(const std::string& line)
{
  std::vector<double> numbers;
  std::istringstream stream(line);
  for (std::string field; std::getline(stream, field, ',');)
    numbers.push_back(std::stod(field));
  return numbers;
}

} // namespace

// Homogeneous deformation: every element has the stress of the law, up to round-off.
TEMPLATE_TEST_CASE_SIG("cell stress of a homogeneous deformation is that of the law", "[solid][unit]",
                       ((int dim), dim), 2, 3)
{
  for (const auto type : element_types<dim>())
    for (const auto& law_name : law_names())
    {
      Solid<dim> solid(soft_config(dim, law_name), distorted_box<dim>(type));
      const auto H = Random(43).matrix<dim>(0.1);
      solid.set_motion([&](const Vec<dim>& X) { return H * X; }, zero_field<dim>());
      const auto expected =
          std::visit([&](const auto& law) { return cauchy_stress(law, H); }, solid.bodies()[0].material);
      const auto stress = cell_stress(solid);
      REQUIRE(stress.von_mises.size() == static_cast<std::size_t>(solid.n_elements()));
      REQUIRE(stress.sigma.size() == 9 * stress.von_mises.size());
      for (std::size_t e = 0; e < stress.von_mises.size(); ++e)
      {
        CHECK(stress.von_mises[e] == Approx(von_mises(expected)).epsilon(1e-11));
        for (std::size_t k = 0; k < 9; ++k)
          CHECK(std::abs(stress.sigma[9 * e + k] - expected.c[k]) < 1e-11 * von_mises(expected));
      }
    }
}

TEMPLATE_TEST_CASE_SIG("a run leaves frames, probes, a ledger and a summary that agree with its end",
                       "[solid][unit]", ((int dim), dim), 2, 3)
{
  const OutputFolder folder;
  auto config = soft_config(dim, "neo_hookean_ln");
  config.gravity = std::vector<double>(dim, 0.0);
  config.gravity[1] = -10.0;
  config.fix = {{"bottom", {"x", "y"}}};
  Solid<dim> solid(config, distorted_box<dim>(element_types<dim>()[0]));
  const OutputConfig output_config{
      .dir = folder.path.string(), .frame_interval = 0.02, .history_interval = 0.01};
  const std::vector<ProbeConfig> probes = {
      {.name = "tip",
       .on = "solid",
       .point = std::vector<double>(dim, 0.74),
       .surface = "",
       .fields = {"u", "v"}},
      {.name = "base", .on = "solid", .point = {}, .surface = "bottom", .fields = {"F"}},
      {.name = "lid", .on = "solid", .point = {}, .surface = "top", .fields = {"a", "u"}},
      {.name = "gauge", .on = "fluid", .point = {0.0, 0.0}, .surface = "", .fields = {"p"}}};
  RunResult result;
  {
    SolidOutput<dim> output(output_config, probes, solid);
    result = run_alone<dim>(solid, {.t_end = 0.1, .frame_interval = 0.02, .history_interval = 0.01}, &output);
  }

  const auto tip = lines_of(folder.path / "history/tip.csv");
  const std::string z_u = dim == 3 ? ",u_z[m]" : "", z_v = dim == 3 ? ",v_z[m/s]" : "";
  CHECK(tip[2] == "t[s],u_x[m],u_y[m]" + z_u + ",v_x[m/s],v_y[m/s]" + z_v);
  Vec<dim> wanted;
  for (int i = 0; i < dim; ++i)
    wanted[i] = 0.74;
  const auto node = static_cast<std::size_t>(nearest_node(solid, wanted));
  const auto last = numbers_of(tip.back());
  CHECK(last[0] == result.t_end);
  for (int i = 0; i < dim; ++i)
  {
    CHECK(last[1 + static_cast<std::size_t>(i)] == solid.nodes().u[node][i]); // 17 digits: the same number
    CHECK(last[1 + static_cast<std::size_t>(dim + i)] == solid.nodes().v[node][i]);
  }
  CHECK(tip.size() == 3 + 11); // t = 0 and ten intervals

  const auto base = numbers_of(lines_of(folder.path / "history/base.csv").back());
  CHECK(base[2] == Approx(solid.reaction(solid.mesh().surfaces.at("bottom").node_set())[1]).epsilon(1e-12));
  CHECK(base[2] > 0.0); // carries weight

  const auto energy = lines_of(folder.path / "history/solid_energy.csv");
  CHECK(energy[2] == "t[s],kinetic[J],strain[J],external_work[J],interface_work[J],balance[J],hourglass[J],"
                     "plastic_work[J],viscous_work[J],contact[J]");
  CHECK(numbers_of(energy.back())[2] == solid.energies().strain);
  CHECK(std::filesystem::file_size(folder.path / "solid.h5") > 0);
  int frames = 0;
  for (const auto& line : lines_of(folder.path / "solid.xdmf"))
    frames += line.find("<Time") != std::string::npos;
  CHECK(frames == 6); // t = 0 and five intervals
  CHECK_FALSE(std::filesystem::exists(folder.path / "history/gauge.csv"));

  const auto json = summarise(solid, result).json();
  CHECK(json.find("\"steps\": " + std::to_string(result.steps)) != std::string::npos);
  CHECK(json.find("\"energy_drift\"") != std::string::npos);
}

TEST_CASE("probes that cannot be are refused", "[solid][unit]")
{
  const Solid<2> solid(soft_config(2, "linear"), distorted_box<2>(ElementType::quadrilateral4));
  const auto check = [&](const std::string& surface, const std::string& field)
  {
    check_probes(
        std::vector<ProbeConfig>{
            {.name = "p", .on = "solid", .point = {}, .surface = surface, .fields = {field}}},
        solid);
  };
  CHECK_NOTHROW(check("top", "u"));
  CHECK_THROWS_WITH(check("tpo", "u"),
                    Catch::Contains("probe \"p\"") && Catch::Contains("did you mean \"top\""));
  CHECK_THROWS_WITH(check("top", "q"), Catch::Contains("u, v, a, F"));
  CHECK_THROWS_WITH(check("top", "von_mises"), Catch::Contains("needs a point"));
}

TEST_CASE("the description tells counts, supports and the step", "[solid][unit]")
{
  auto config = soft_config(2, "svk");
  config.fix = {{"bottom", {"y"}}};
  config.wet = {{"gamma", "top"}};
  const auto mesh = box_mesh<2>(Vec<2>{}, Vec<2>{{1.0, 1.0}}, {3, 2}, ElementType::triangle3);
  const Solid<2> solid(config, mesh);
  const auto text = describe(config, solid, 1.0);
  for (const char* part :
       {"svk: density 1000", "12 T3", "12, 4 of them wet", "gamma on surface top", "bottom: y"})
    CHECK(text.find(part) != std::string::npos);
}
