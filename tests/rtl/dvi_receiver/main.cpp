// The simulated boards' receiver of DVI, alone: the pixels and the counts of the levels of four pairs, a byte each, from
// stdin.
//
//   receiver WIDTH HEIGHT H_FRONT H_SYNC H_BACK V_FRONT V_SYNC V_BACK H_POSITIVE V_POSITIVE
#include <cstdio>
#include <cstdlib>

#include "../../../sim/netlist/dvi.h"

int main(int count, char** words) {
  int numbers[10] = {};
  for (int k = 0; k < 10 && k + 1 < count; ++k) numbers[k] = std::atoi(words[k + 1]);
  const auto& n = numbers;
  dvi::Receiver receiver({n[0], n[1], n[2], n[3], n[4], n[5], n[6], n[7], n[8] != 0, n[9] != 0});
  std::printf("{\"pixels\": \"");
  for (int levels; (levels = std::getchar()) != EOF;)
    if (receiver.bit(static_cast<uint8_t>(levels)) && receiver.pixel().de)
      std::printf("%06x", static_cast<unsigned>(receiver.pixel().rgb));
  std::printf("\", %s}\n", receiver.counts().c_str());
}
