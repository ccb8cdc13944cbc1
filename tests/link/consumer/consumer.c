/* Uses the installed library as a stranger would: started alone, every wrong call must be refused with words.
 */
#include <undine_link.h>

#include <stdio.h>
#include <string.h>

static int failures = 0;

static void expect(int holds, const char* claim)
{
  printf("%s: %s\n", holds ? "ok" : "FAIL", claim);
  failures += !holds;
}

int main(int argc, char** argv)
{
  int major = 0, minor = -1;
  undine_protocol_version(&major, &minor);
  expect(major == 1 && minor == 0, "the library speaks protocol 1.0");
  expect(undine_arm(NULL, 1.0) == UNDINE_INTERNAL_ERROR, "arm without a role is refused");
  expect(undine_arm("solid", 10.0) == UNDINE_OK, "arm before MPI_Init");
  MPI_Init(&argc, &argv);

  undine_link* link = (undine_link*)&major;
  expect(undine_open(NULL, "solid", "consumer", 1.0, 1.0) == UNDINE_INTERNAL_ERROR,
         "open needs a place for the link");
  expect(undine_open(&link, "solid", NULL, 1.0, 1.0) == UNDINE_INTERNAL_ERROR && link == NULL,
         "open needs a name");
  const int code = undine_open(&link, "solid", "consumer", 1.0, 1.0);
  expect(code == 35 && link == NULL, "started alone: code 35, no link");
  expect(strstr(undine_last_error(NULL), "no program with role 'coupler'") != NULL,
         "the words name the missing role");

  undine_setup setup;
  undine_window window;
  const undine_report report = {.stable_dt = 1.0};
  double x[2] = {0.0, 0.0};
  expect(undine_receive_setup(NULL, &setup) == UNDINE_INTERNAL_ERROR, "no setup without a link");
  expect(undine_set_nodes(NULL, 1, NULL, x, x, NULL) == UNDINE_INTERNAL_ERROR, "no nodes without a link");
  expect(undine_send_report(NULL, &report) == UNDINE_INTERNAL_ERROR, "no report without a link");
  expect(undine_next_window(NULL, &window) == UNDINE_INTERNAL_ERROR, "no window without a link");
  expect(undine_exchange(NULL, x, x) == UNDINE_INTERNAL_ERROR, "no exchange without a link");
  expect(undine_interface_name(NULL, 0) == NULL, "no name without a link");
  expect(undine_comm(NULL) == MPI_COMM_NULL, "no communicator without a link");
  undine_surface surface;
  expect(undine_in_contact(NULL) == 0, "no contact without a link");
  expect(undine_receive_surface(NULL, &surface) == UNDINE_INTERNAL_ERROR, "no surface without a link");
  expect(undine_wait_seconds(NULL) == 0.0, "no waiting without a link");
  undine_close(NULL);
  MPI_Finalize();
  return failures;
}
