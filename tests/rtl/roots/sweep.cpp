// Every word of a range through a root, one a clock.
#include <cstdint>
#include <memory>

#include "Vtop.h"
#include "verilated.h"

extern "C" __attribute__((visibility("default"))) void lippmann_sweep(int64_t low, int64_t high, int32_t* out) {
  auto context = std::make_unique<VerilatedContext>();
  auto top = std::make_unique<Vtop>(context.get());
  top->eval();
  const int64_t latency = top->latency_o;
  for (int64_t clock = 0; clock < high - low + latency; ++clock) {
    top->x_i = static_cast<uint32_t>(low + clock < high ? low + clock : low);
    top->clk_i = 1;
    top->eval();
    top->clk_i = 0;
    top->eval();
    // After the edge that takes word n in, the output is that of word n - latency + 1.
    if (clock + 1 >= latency && clock + 1 - latency < high - low) {
      out[clock + 1 - latency] = static_cast<int32_t>(top->y_o);
    }
  }
}
