// What the fake coupler says to a program, from SETUP to BYE, and what it learns.
// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include "common/coupling/conform/scripts.hpp"
#include "common/coupling/link.hpp"

#include <fstream>
#include <string>
#include <vector>

namespace undine::link::conform
{

/// Findings of one run, kept on disk line by line: a run may end in the middle.
class Findings
{
public:
  explicit Findings(const std::string& folder) : out_(folder + "/findings", std::ios::app) {}
  void expect(bool holds, const std::string& clause, const std::string& text)
  {
    out_ << (holds ? "pass" : "FAIL") << '\t' << clause << '\t' << text << std::endl;
  }
  void note(const std::string& clause, const std::string& text)
  {
    out_ << "note" << '\t' << clause << '\t' << text << std::endl;
  }

private:
  std::ofstream out_;
};

/// Everything the program answered.
struct Record
{
  SurfaceMesh mesh;
  std::vector<std::vector<double>> v_free; ///< per exchange
  std::vector<double> dt;                  ///< per exchange: step that led to it
};

/// What the script adds to the zero forces: a velocity change of the order `kick` at all free components.
struct Push
{
  int exchange = -1;       ///< link force after that exchange
  bool activation = false; ///< impulse and link force of the first activation
};

/// Euclidean norm.
double norm(const std::vector<double>&);

/// y = M⁻¹ f per node.
std::vector<double> times_inverse_mass(const SurfaceMesh& mesh, const std::vector<double>& f);

/// The kick as a nodal vector of momentum [N s]: 1e-3 m/s per component for a node of the mean mass.
std::vector<double> kick(const SurfaceMesh& mesh);

/// SETUP of the scripts.
Setup setup_of(const Options& options);

/// SETUP to the first READY.
Report begin(PartnerLink& link, const Options& options, SurfaceMesh& mesh);

/// Plays the plan with zero forces and the push.
/// @param trials  windows with sub-steps are ordered on trial first; findings must be given
Record converse(PartnerLink& link, const Options& options, const Push& push, Findings* findings,
                bool trials = false);

/// Scheme "contact": the plan's windows with one step each, the exchange in the middle.
Record converse_in_contact(PartnerLink& link, const Options& options, const Push& push, Findings* findings);

/// Scheme "contact": a kick in the first step, then `length` steps without link force, one by one or in one
/// window without exchange, then another step. Three velocities: of the first step, the mean over the steps
/// in between, of the last step.
Record fly(PartnerLink& link, const Options& options, bool in_flight, Findings& findings);

} // namespace undine::link::conform
