/* A plate on springs as a solid of its own, in C: the smallest program behind the coupling protocol. */
#include "undine_link.h"

#include <stdio.h>
#include <string.h>

#define N 9                              /* nodes along the plate */
static const double width = 0.1;         /* [m] */
static const double m = 1000.0;          /* mass per area [kg/m2] */
static const double k = 1e9;             /* springs, force per area and displacement [N/m3] */
static const double g[2] = {0.0, -10.0}; /* [m/s2] */

int main(int argc, char** argv)
{
  const char* out = argc > 3 && strcmp(argv[2], "--out") == 0 ? argv[3] : ".";
  char file[4096];
  snprintf(file, sizeof file, "%s/history/interface.csv", out);

  undine_link* link;
  undine_setup setup;
  undine_window w;
  undine_report report = {0};
  undine_arm("solid", 60.0);
  MPI_Init(&argc, &argv);
  int code = undine_open(&link, "solid", "plate in C", 60.0, 300.0);
#define TRY(call)                                                                                            \
  if ((code = (call)) != UNDINE_OK)                                                                          \
  undine_abort(link, code, NULL, out)
  TRY(code);
  TRY(undine_receive_setup(link, &setup));

  double x[N][2], mass[N], spring[N], u[N][2] = {0}, v[N][2] = {0}, a[N][2], f[N][2], p[N][2];
  int32_t fixed[N][2], faces[N - 1][2];
  for (int n = 0; n < N; ++n)
  {
    const double length = width / (N - 1) * (n == 0 || n == N - 1 ? 0.5 : 1.0);
    x[n][0] = width * n / (N - 1), x[n][1] = 0.0;
    mass[n] = m * length, spring[n] = k * length;
    fixed[n][0] = 1, fixed[n][1] = 0;
    a[n][0] = 0.0, a[n][1] = g[1]; /* at rest, springs relaxed */
    if (n > 0)
      faces[n - 1][0] = n, faces[n - 1][1] = n - 1; /* the plate lies to the left, below */
    report.mass += mass[n];
  }
  TRY(undine_set_nodes(link, N, NULL, x[0], mass, fixed[0]));
  TRY(undine_add_faces(link, "wet", N - 1, 2, faces[0]));
  TRY(undine_send_surface(link));

  FILE* history = fopen(file, "w");
  if (history == NULL)
    undine_abort(link, 11, "cannot write history/interface.csv", out);
  fprintf(history, "t[s],u_y[m],v_y[m/s]\n%.9g,0,0\n", setup.t_begin);
  report.stable_dt = 0.9 * 2.0 / 1000.0; /* 2 / sqrt(k/m) */
  TRY(undine_send_report(link, &report));
  while ((code = undine_next_window(link, &w)) == UNDINE_OK)
  {
    const double dt = (w.t_end - w.t_begin) / (double)w.steps;
    if (w.activate)
    {
      TRY(undine_send_kinematics(link, v[0], a[0]));
      TRY(undine_receive_activation(link, p[0], f[0]));
      for (int n = 0; n < N; ++n)
        v[n][1] += p[n][1] / mass[n], a[n][1] += f[n][1] / mass[n];
    }
    for (int64_t j = 1; j <= w.steps; ++j)
    {
      for (int n = 0; n < N; ++n)
      {
        v[n][1] += 0.5 * dt * a[n][1];
        u[n][1] += dt * v[n][1];
        a[n][1] = g[1] - spring[n] * u[n][1] / mass[n];
        v[n][1] += 0.5 * dt * a[n][1];
      }
      if (!w.fine && j < w.steps)
        continue;
      TRY(undine_exchange(link, v[0], f[0]));
      for (int n = 0; n < N; ++n)
        a[n][1] += f[n][1] / mass[n], v[n][1] += 0.5 * dt * f[n][1] / mass[n];
    }
    report.steps += w.steps;
    report.kinetic_energy = report.internal_energy = report.external_work = 0.0;
    for (int n = 0; n < N; ++n)
    {
      report.kinetic_energy += 0.5 * mass[n] * v[n][1] * v[n][1];
      report.internal_energy += 0.5 * spring[n] * u[n][1] * u[n][1];
      report.external_work += mass[n] * g[1] * u[n][1];
    }
    fprintf(history, "%.9g,%.17g,%.17g\n", w.t_end, u[N / 2][1], v[N / 2][1]);
    fflush(history);
    TRY(undine_send_report(link, &report));
  }
  if (code != UNDINE_END)
    undine_abort(link, code, NULL, out);
  fclose(history);
  undine_close(link);
  MPI_Finalize();
  return 0;
}
