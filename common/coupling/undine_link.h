/* The coupling protocol for solvers in C, Fortran, Python, or whatever can call C.
 * SPDX-License-Identifier: BSD-3-Clause
 *
 * A solver with an explicit time integration and a lumped mass takes part in a coupled run by fifteen calls. It
 * sends its wet surface and, at synchronised times, the free velocity of the wet nodes (without any link force);
 * it receives the link force that makes both sides move together. docs/protocol.md tells the rest; the loop is
 *
 *   undine_arm("solid", 60);  MPI_Init(...);                       undine_open(&link, "solid", "mine 1.0", ...);
 *   undine_receive_setup(link, &setup);
 *   undine_set_nodes(link, n, ...);  undine_add_faces(link, "wet", ...);  undine_send_surface(link);
 *   undine_send_report(link, &report);
 *   while ((code = undine_next_window(link, &window)) == UNDINE_OK)
 *   {
 *     if (window.activate) { undine_send_kinematics(link, v, a_free);  undine_receive_activation(link, p, f); }
 *     for (j = 1; j <= window.steps; ++j)
 *     {
 *       v += dt/2 a;  u += dt v;  a = M^-1 F(u);  v += dt/2 a;              // central differences
 *       if (window.fine || j == window.steps)
 *         { undine_exchange(link, v, f);  a += M^-1 f;  v += dt/2 M^-1 f; }
 *     }
 *     undine_send_report(link, &report);
 *   }
 *   undine_close(link);  MPI_Finalize();
 *
 * Rules of this interface
 * - SI units. Vectors of the wet surface are rows of `dim` doubles, one row per wet node, in the order of
 *   undine_set_nodes.
 * - Every function returns UNDINE_OK (0), UNDINE_END or UNDINE_CHECKPOINT (undine_next_window only), or an exit code > 0 of
 *   docs/protocol.md; undine_last_error() then has the words. No C++ exception leaves the library, and nothing but
 *   undine_abort ends the process.
 * - The functions may be called from one thread at a time, the one that may call MPI.
 * - A solver opened by undine_open_contact asks undine_in_contact after the set-up. If it says 1, every window is one step
 *   with the exchange in its middle, and never has `activate`:
 *     v += dt/2 a;  undine_exchange(link, v, f);  v += dt M^-1 f;  u += dt v;  a = M^-1 F(u);  v += dt/2 a;
 * - A parallel solver opens the link on all its ranks, uses undine_comm() wherever it would use MPI_COMM_WORLD, and
 *   calls everything else on rank 0 of undine_comm(). Or it calls undine_distribute: then all ranks call everything, each
 *   with the wet nodes of its own, and nothing is gathered.
 * - Null pointers and negative sizes are refused with code 1.
 */
#ifndef UNDINE_LINK_H
#define UNDINE_LINK_H

#include <mpi.h>

#include <stdint.h>

#ifdef __cplusplus
extern "C"
{
#endif

/* Version of this interface; that of the protocol is undine_protocol_version(). */
#define UNDINE_LINK_VERSION_MAJOR 1
#define UNDINE_LINK_VERSION_MINOR 0

/* Return codes that a solver treats specially; the others are in docs/protocol.md, "Exit codes". */
#define UNDINE_OK 0
#define UNDINE_END (-1)          /* orderly end: no further window */
#define UNDINE_CHECKPOINT (-2)   /* undine_next_window, after undine_offer_checkpoints: write the state */
#define UNDINE_INTERNAL_ERROR 1  /* wrong use of this interface */
#define UNDINE_NUMERICAL_ERROR 10 /* for undine_abort: the solution broke down */

/* One conversation with the coupler. */
typedef struct undine_link undine_link;

/* The run as the coupler read it from the case. */
typedef struct undine_setup
{
  int32_t dim;          /* 2 or 3 */
  int32_t n_interfaces; /* their names: undine_interface_name */
  double t_begin;       /* [s] */
  double t_end;         /* [s] */
} undine_setup;

/* Orders for one window. */
typedef struct undine_window
{
  int64_t index;    /* 0, 1, 2, ... */
  int64_t steps;    /* equal steps of this solver inside the window, of (t_end - t_begin) / steps */
  double t_begin;   /* [s] */
  double t_end;     /* [s] */
  int32_t fine;     /* 1: exchange at the end of every step; 0: at the end of the last one only */
  int32_t activate; /* 1: undine_send_kinematics and undine_receive_activation come first */
  int32_t output;   /* 1: write a frame at t_end */
  int32_t last;     /* 1: the run ends at t_end */
} undine_window;

/* State of the solver at a window end. Only stable_dt is needed; what is not known stays zero. */
typedef struct undine_report
{
  double stable_dt;         /* largest step it can take next, safety factor included [s]; > 0 */
  double kinetic_energy;    /* [J] */
  double internal_energy;   /* [J] */
  double external_work;     /* cumulated, of gravity, loads and prescribed motion [J] */
  double dissipated_energy; /* cumulated [J] */
  double interface_work;    /* cumulated, of the link forces on this solver [J] */
  double mass;              /* [kg] */
  int64_t steps;            /* cumulated */
  int32_t surface_changed;  /* 1: a new surface follows (set_nodes, add_faces, send_surface) */
  int32_t reserved;         /* 0 */
} undine_report;

/* Version of the protocol that this library speaks. */
void undine_protocol_version(int* major, int* minor);

/* Optional, before MPI_Init: if the launch is incomplete after `seconds` (a program of the mpirun line never calls
 * MPI_Init), say so and end with code 31 instead of waiting for ever. */
int undine_arm(const char* role, double seconds);

/* Hand-shake with the other programs of the mpirun line; collective over the ranks of this program.
 *   role             "solid" (or "fluid"): the part this program plays
 *   solver           name and version for people, at most 95 bytes
 *   hello_seconds    every program must have spoken by then; 0: no limit
 *   stall_seconds    the coupler may be silent for that long; 0: no limit
 * @returns 31 to 35 when the programs do not fit together; *link is NULL then */
int undine_open(undine_link** link, const char* role, const char* solver, double hello_seconds,
                double stall_seconds);

/* The same for a solver at level A: any code that takes nodal forces and returns positions and velocities, by whatever
 * integration. The coupler takes such a solver as "solid" when the case says coupling.scheme = "staggered", and only if
 * the bound of docs/protocol.md, 8.2, holds: the fluid's interface masses smaller than the solid's.
 * Its loop: undine_send_surface, undine_send_motion, undine_send_report; then per window undine_next_window,
 * undine_receive_link_force (constant over the window), steps of its own to t_end, undine_send_motion,
 * undine_send_report. */
int undine_open_force_in(undine_link** link, const char* role, const char* solver, double hello_seconds,
                         double stall_seconds);

/* The same as undine_open for a solver that can also serve an interface whose contact opens and closes
 * (separation = true): it then exchanges in the middle of its step, see undine_in_contact. */
int undine_open_contact(undine_link** link, const char* role, const char* solver, double hello_seconds,
                        double stall_seconds);

/* Optional, after undine_open..., before undine_receive_setup: from here on every rank has wet nodes of its own (or none)
 * and exchanges their rows with the coupler directly. Collective over the ranks of this program, like, from here on,
 *   undine_receive_setup, undine_receive_surface, undine_send_surface, undine_next_window:  rank 0 talks, all have its result,
 *   and if it fails all return its code;
 *   undine_send_report:  that of rank 0 is sent, its numbers are those of all ranks together; surface_changed is the same on all;
 *   undine_send_kinematics, undine_receive_activation, undine_send_free_velocity, undine_receive_link_force, undine_exchange,
 *   undine_send_motion:  with the rows of the rank's own nodes; a rank without nodes may pass NULL;
 *   undine_checkpoint_done, undine_request_stop:  those of rank 0 count; it answers when all ranks have written.
 * undine_set_nodes and undine_add_faces... are not collective: each rank gives its own nodes, with node_id, every node on one
 * rank only, and faces, every face on one rank only. The coupler sees the nodes in the order of node_id and the faces in that of
 * their nodes, so that the number of ranks changes no bit of its answers.
 * @returns 35 if the coupler does not offer DISTRIBUTED */
int undine_distribute(undine_link* link);

/* Communicator of the ranks of this program; belongs to the link. The second form is for Fortran and mpi4py. */
MPI_Comm undine_comm(const undine_link* link);
MPI_Fint undine_comm_f(const undine_link* link);

/* The last failure in words; valid until the next call. With link = NULL: of undine_arm and undine_open. */
const char* undine_last_error(const undine_link* link);

/* SETUP: waits for the coupler. */
int undine_receive_setup(undine_link* link, undine_setup* setup);
/* Name of interface i of the setup, 0 <= i < n_interfaces; NULL otherwise. */
const char* undine_interface_name(const undine_link* link, int32_t i);

/* After the set-up, of undine_open_contact: 1 if contact opens and closes in this run, 0 if the interface stays. */
int undine_in_contact(const undine_link* link);

/* The wet surface of the other participant, as sent for contact. */
typedef struct undine_surface
{
  int64_t n_nodes, n_faces;
  const double* x;            /* n_nodes x dim, present positions [m] */
  const int32_t* face_offset; /* n_faces + 1, from 0, into face_nodes */
  const int32_t* face_nodes;  /* positions in x, outward of that body */
} undine_surface;

/* Only a fluid in contact: SURFACE comes before each undine_send_surface. The pointers are valid until the next call.
 * A second undine_send_report follows each undine_send_surface but the first. */
int undine_receive_surface(undine_link* link, undine_surface* surface);

/* The wet surface is collected by the next functions and sent by undine_send_surface.
 *   n         number of wet nodes, each once even if it is on several interfaces
 *   node_id   n global numbers, unique, >= 0; NULL: 0, 1, 2, ...
 *   x         n x dim, present positions [m]
 *   mass      n, lumped masses [kg]
 *   fixed     n x dim, 1 where a component is prescribed and must not be moved by a link force; NULL: nowhere */
int undine_set_nodes(undine_link* link, int64_t n, const int64_t* node_id, const double* x, const double* mass,
                     const int32_t* fixed);
/* The same with a symmetric matrix per node, e.g. for a roller on an incline: inverse_mass is n x dim x dim [1/kg]. */
int undine_set_nodes_with_matrix(undine_link* link, int64_t n, const int64_t* node_id, const double* x,
                                 const double* inverse_mass);
/* Faces of one interface; may be called several times, also for one interface with faces of different kinds.
 *   interface_name  one of the setup
 *   face_nodes      n_faces x nodes_per_face, positions 0 <= k < n in the arrays of undine_set_nodes. Outward of this
 *                   body: in 2-D the body lies to the left when one walks from the first node to the second, in 3-D
 *                   the nodes run counterclockwise when seen from outside */
int undine_add_faces(undine_link* link, const char* interface_name, int64_t n_faces, int32_t nodes_per_face,
                     const int32_t* face_nodes);
/* After undine_distribute: the same by node_id, for faces that have nodes of other ranks. */
int undine_add_faces_by_id(undine_link* link, const char* interface_name, int64_t n_faces, int32_t nodes_per_face,
                           const int64_t* node_ids);
/* First call: MESH, and waits for the answer; 4 if the coupler rejects the surface. Later: MESH_UPDATE, directly
 * after a report with surface_changed. */
int undine_send_surface(undine_link* link);

/* READY: state at the start and at each window end. */
int undine_send_report(undine_link* link, const undine_report* report);

/* Optional, before undine_receive_setup: this solver can write its state and continue from it. Without this call the
 * library answers orders for checkpoints by "cannot", and a restart is refused with code 2. */
int undine_offer_checkpoints(undine_link* link);
/* Folder of the checkpoint to continue from, known after undine_receive_setup; NULL: the run begins at t_begin. The
 * surface, motion and report that follow are those of the restored state. */
const char* undine_restart_folder(const undine_link* link);
/* After UNDINE_CHECKPOINT: the folder, which exists. Write the state into a file there (a parallel solver: one file in
 * all, or a name of its own for each), and answer with its name, or with file_name = NULL and the reason why not. */
const char* undine_checkpoint_folder(const undine_link* link);
int undine_checkpoint_done(undine_link* link, const char* file_name, const char* reason);

/* Waits for WINDOW. @returns UNDINE_END after the coupler's BYE, which it acknowledges; UNDINE_CHECKPOINT (only after
 * undine_offer_checkpoints): answer by undine_checkpoint_done and call again */
int undine_next_window(undine_link* link, undine_window* window);

/* Start of a window with `activate`: velocity [m/s] and free acceleration M^-1 F without link force [m/s2], both
 * n x dim. The answer: v <- v + M^-1 impulse [N s], a <- a_free + M^-1 link_force [N]. */
int undine_send_kinematics(undine_link* link, const double* v, const double* a_free);
int undine_receive_activation(undine_link* link, double* impulse, double* link_force);

/* Synchronised time: free velocity out [m/s], link force in [N], both n x dim. Between the two calls there is time to
 * compute what does not depend on the link force (everything but the wet nodes); undine_exchange is both at once. */
int undine_send_free_velocity(undine_link* link, const double* v_free);
int undine_receive_link_force(undine_link* link, double* link_force);
int undine_exchange(undine_link* link, const double* v_free, double* link_force);

/* Level A: position [m] and velocity [m/s] of the wet nodes at the start and at each window's end, both n x dim. */
int undine_send_motion(undine_link* link, const double* x, const double* v);

/* "Please end after this window", e.g. on a signal. */
int undine_request_stop(undine_link* link, const char* reason);

/* "Alive": inside long pieces of work, as often as one likes. */
int undine_ping(undine_link* link);

/* Total time spent waiting for the coupler [s]. */
double undine_wait_seconds(const undine_link* link);

/* The one way out after a failure: tells the coupler, prints the text, writes FAILED.toml into out_dir and ends all
 * programs with `code`. Does not return.
 *   link     may be NULL (the failure came before or from undine_open)
 *   text     NULL: undine_last_error
 *   out_dir  NULL or "": no FAILED.toml */
void undine_abort(undine_link* link, int code, const char* text, const char* out_dir);

/* Ends the link; collective over the ranks of this program, before MPI_Finalize. NULL is allowed. */
void undine_close(undine_link* link);

#ifdef __cplusplus
}
#endif

#endif
