// The header in a C++ program.
#include <undine_link.h>

int main()
{
  int major = 0, minor = 0;
  undine_protocol_version(&major, &minor);
  return major == UNDINE_LINK_VERSION_MAJOR ? 0 : 1;
}
