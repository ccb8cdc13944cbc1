/* A solid of --nodes nodes without physics in C: for the latency of an exchange. See latency.py. */
#include "undine_link.h"

#include <stdlib.h>
#include <string.h>

int main(int argc, char** argv)
{
  const int n = argc > 1 ? atoi(argv[1]) : 64;
  undine_link* link = NULL;
  undine_setup setup;
  undine_window window;
  undine_report report = {.stable_dt = 1e-3};
  undine_arm("solid", 20.0);
  MPI_Init(&argc, &argv);
  int code = undine_open(&link, "solid", "latency in C", 20.0, 20.0);
#define TRY(call) if ((code = (call)) != UNDINE_OK) undine_abort(link, code, NULL, NULL)
  TRY(code);
  double* x = calloc(2 * (size_t)n, sizeof *x);
  double* f = calloc(2 * (size_t)n, sizeof *f);
  double* p = calloc(2 * (size_t)n, sizeof *p);
  double* mass = calloc((size_t)n, sizeof *mass);
  int32_t* faces = calloc(2 * (size_t)n, sizeof *faces);
  for (int k = 0; k < n; ++k)
    x[2 * k] = k, mass[k] = 1.0, faces[2 * k] = k, faces[2 * k + 1] = k + 1;
  TRY(undine_receive_setup(link, &setup));
  TRY(undine_set_nodes(link, n, NULL, x, mass, NULL));
  TRY(undine_add_faces(link, "line", n - 1, 2, faces));
  TRY(undine_send_surface(link));
  TRY(undine_send_report(link, &report));
  while ((code = undine_next_window(link, &window)) == UNDINE_OK)
  {
    if (window.activate)
    {
      TRY(undine_send_kinematics(link, x, x));
      TRY(undine_receive_activation(link, p, f));
    }
    for (int64_t j = 0; j < (window.fine ? window.steps : 1); ++j)
      TRY(undine_exchange(link, x, f));
    TRY(undine_send_report(link, &report));
  }
  if (code != UNDINE_END)
    undine_abort(link, code, NULL, NULL);
  undine_close(link);
  free(x), free(f), free(p), free(mass), free(faces);
  MPI_Finalize();
  return 0;
}
