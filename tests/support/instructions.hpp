// How many instructions the machine executes, counted one by one: needs no counters of the processor, which
// virtual machines hide, and knows every instruction set, which emulators do not.
#pragma once

#include <cstdint>

#include <sys/ptrace.h>
#include <sys/user.h>
#include <sys/wait.h>
#include <unistd.h>

#include <csignal>

namespace undine::test
{

struct Instructions
{
  std::int64_t all = 0;
  std::int64_t of_eight = 0; ///< on registers of 512 bits: EVEX prefix with the length 512
};

/// What act() executes, in a copy of this process: nothing is changed here. Microseconds per instruction.
/// x86-64, one thread.
template <class Act>
Instructions count_instructions(Act&& act)
{
  const pid_t child = fork();
  if (child == 0)
  {
    ptrace(PTRACE_TRACEME, 0, nullptr, nullptr);
    raise(SIGSTOP);
    act();
    raise(SIGSTOP);
    _exit(0);
  }
  Instructions count;
  int status = 0;
  waitpid(child, &status, 0); // the first stop
  for (;;)
  {
    ptrace(PTRACE_SINGLESTEP, child, nullptr, nullptr);
    waitpid(child, &status, 0);
    if (!WIFSTOPPED(status) || WSTOPSIG(status) == SIGSTOP)
      break;
    ++count.all;
    user_regs_struct registers;
    ptrace(PTRACE_GETREGS, child, nullptr, &registers);
    // 62 P0 P1 P2 opcode …: in P2 bits 6 and 5 are the length of the vector.
    const long text = ptrace(PTRACE_PEEKTEXT, child, registers.rip, nullptr);
    count.of_eight += (text & 0xff) == 0x62 && (text >> 24 & 0x60) == 0x40;
  }
  ptrace(PTRACE_KILL, child, nullptr, nullptr);
  waitpid(child, &status, 0);
  return count;
}

} // namespace undine::test
