// What the Gravouil-Combescure window needs from a fluid or a solid: two verbs.
#pragma once

#include <span>

namespace undine::coupler
{

/// A participant seen from a window. Implemented by the protocol link, and by small models in tests.
class Partner
{
public:
  virtual ~Partner() = default;
  /// Free velocity on the wet surface at the next synchronised time of this participant [m/s], n × dim. Waits
  /// for it.
  virtual void receive_free_velocity(std::span<double> v_free) = 0;
  /// Nodal link force at that time [N], n × dim.
  virtual void send_link_force(std::span<const double> f_link) = 0;
};

} // namespace undine::coupler
