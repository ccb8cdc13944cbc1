// What a case says about the solid: geometry, material, supports, loads.
#pragma once

#include "common/mesh/mesh.hpp"
#include "solid_fe/material.hpp"
#include "solid_fe/reference_block.hpp"

#include <string>
#include <vector>

namespace undine::solid
{

/// `[[solid.fix]]`: components of a surface or node set that do not move (a roller fixes one of them).
struct FixConfig
{
  std::string on;
  std::vector<std::string> components; ///< of "x", "y", "z"; of a beam "x", "y", "rotation"
};

/// `[[solid.velocity]]`, `[[solid.acceleration]]`: prescribed motion of a surface or node set.
struct VelocityConfig
{
  std::string on;
  std::vector<double> value;           ///< [m/s], dim numbers
  std::vector<std::string> components; ///< those prescribed; empty: all
  std::vector<std::string> function;   ///< of x, y, z, t, dim formulas; instead of value if not empty
  bool is_acceleration = false; ///< value or function are an acceleration [m/s²] from the initial velocity on
};

/// `[[solid.traction]]`: dead load per reference area of a surface.
struct TractionConfig
{
  std::string on;
  std::vector<double> value; ///< [Pa], dim numbers
  double ramp = 0.0;         ///< grows linearly from 0 to full over this time [s]; 0: full from the start
  std::vector<std::string>
      function; ///< of x, y, z (reference position) and t, dim formulas; instead of value
};

/// `[[solid.pressure]]`: load along the inward normal of the deformed surface.
struct PressureConfig
{
  std::string on;
  std::string function; ///< of x, y, z (reference position) and t [Pa]
};

/// `[[solid.wall]]`: a rigid plane that nodes cannot pass.
struct WallConfig
{
  std::vector<double> point;  ///< of the plane [m]
  std::vector<double> normal; ///< to the side where the solid is
  double friction = 0.0;      ///< Coulomb's coefficient
  std::string on;             ///< surface or node set; empty: the whole boundary
};

/// `[[solid.contact]]`: nodes that cannot pass a surface of the solid.
struct ContactConfig
{
  std::string nodes;   ///< surface or node set
  std::string surface; ///< may be the same: self-contact
  double friction = 0.0;
};

/// How contact pushes.
enum class ContactMethod
{
  penalty,
  impulse
};

/// A surface of the solid that takes part in the interface of that name.
struct WetConfig
{
  std::string interface;
  std::string surface;
};

/// The built-in box, or nothing if a mesh file is named.
struct GeometryConfig
{
  std::string mesh_file; ///< Gmsh file, resolved; empty: the box
  ElementType element = ElementType::quadrilateral4;
  std::vector<double> origin, size; ///< of the box [m], dim numbers
  std::vector<int> elements;        ///< along each axis of the box, dim numbers
  std::vector<double>
      line; ///< x, y, x, y, …: middle line of a thin wall [m]; instead of the box if not empty
  double thickness = 0.0;    ///< of that wall, or of one about the two-node elements of the mesh file [m]
  double element_size = 0.0; ///< along the line [m]
  double inner_radius = 0.0; ///< of a ring about `origin`, in 3-D along z: size and elements are those of the
                             ///< box around, across (and along); 0: a box [m]
  double angle = 0.0;        ///< the box is turned by this about its origin, in the x-y plane [rad]
};

struct SolidConfig
{
  int dim = 2;
  PlaneKind plane = PlaneKind::strain;
  Formulation formulation = Formulation::full;
  double hourglass_stiffness = 0.1; ///< one-point elements: fraction of E V Σ |∇N|²
  double hourglass_viscosity = 0.0; ///< one-point elements: c of the modal force c √(K m) q̇
  GeometryConfig geometry;
  MaterialConfig material;
  std::vector<double> gravity;                        ///< body force per mass [m/s²], dim numbers
  std::vector<double> initial_velocity;               ///< [m/s], dim numbers
  std::vector<std::string> body_force_function;       ///< per mass, added to gravity, dim formulas or none
  std::vector<std::string> initial_velocity_function; ///< dim formulas, instead of initial_velocity, or none
  std::vector<FixConfig> fix;
  std::vector<VelocityConfig> velocity;
  std::vector<TractionConfig> traction;
  std::vector<PressureConfig> pressure;
  std::vector<WallConfig> wall;
  std::vector<ContactConfig> contact;
  std::vector<std::string> rigid; ///< surfaces or node sets, each of which moves as one rigid body
  ContactMethod contact_method = ContactMethod::penalty;
  double contact_stiffness = 0.1; ///< penalty stiffness relative to ω² m
  std::vector<WetConfig> wet;
  double step_safety = 0.9;        ///< fraction of the stable step that is offered
  double scaled_step = 0.0;        ///< mass is added until the step at rest is this [s]; 0: none
  bool measures_frequency = false; ///< the true highest frequency instead of the bound, see step_limit.hpp
  bool skips_idle_elements = true; ///< false only to compare: elements that keep their shape work like others
};

/// The mesh the configuration asks for: generated, or read.
/// @throws InputError for an unreadable or invalid file, or a file without elements of dimension dim
template <int dim>
Mesh<dim> make_mesh(const SolidConfig& config);

/// Element counts of a box of `size` with elements of about `element_size`: max(1, round(L / h)) along each
/// axis.
std::vector<int> element_counts(const std::vector<double>& size, double element_size);

/// The numbers of a configured vector. @throws InputError if there are not dim of them (`key` names it);
/// empty means zero
template <int dim>
Vec<dim> to_vec(const std::vector<double>& numbers, const std::string& key);

} // namespace undine::solid
