// SPDX-License-Identifier: Apache-2.0
// Batch harness: wraps Verilated `lipp_ray_stream` in a shared library that traces arrays of rays.
//
// On request, random pauses are inserted, so that a comparison of results also tests the
// handshakes. The Python module lippmann.simulation.harness compiles this file once for each build.
#include <cstdint>
#include <cstring>
#include <memory>

#include "Vtop.h"
#include "Vtop___024root.h"
#include "verilated.h"

namespace {

// Random generator xorshift64*: fast, and a seed reproduces the pauses.
class Random {
 public:
  explicit Random(uint64_t seed) : state_(seed * 2 + 1) {}
  // Returns true with probability share / 256.
  bool chance(uint32_t share) {
    state_ ^= state_ >> 12;
    state_ ^= state_ << 25;
    state_ ^= state_ >> 27;
    return (state_ * 2685821657736338717ULL >> 56) < share;
  }

 private:
  uint64_t state_;
};

template <typename T>
int32_t signed_word(T word, int bits) {
  const int shift = 32 - bits;
  return static_cast<int32_t>(static_cast<uint32_t>(word) << shift) >> shift;
}

// Runs one rising edge of the clock. The RTL does nothing at the falling edge, so the model is not
// evaluated there: setting back the model's stored clk_i saves half of the evaluations.
void clock(Vtop& top) {
  top.clk_i = 1;
  top.eval();
  top.clk_i = 0;
  top.rootp->__Vtrigprevexpr___TOP__clk_i__0 = 0;
}

}  // namespace

// Traces `count` rays. The inputs are arrays of the words u, v, a, b. `out` receives 9 consecutive
// arrays of the words i, j, x, y, z, dx, dy, dz, status. `config` contains the bits of
// optics_config_t, least significant word first. In each clock the input pauses with a probability
// of idle / 256, and the output with a probability of stall / 256. Returns the number of clocks
// from the first offered ray to the last exit ray, or -1 if no ray leaves for too long. The library
// exports only this function (-fvisibility=hidden), so that the compiler can inline the model.
extern "C" __attribute__((visibility("default"))) int64_t lippmann_trace(
    int64_t count, const int64_t* u, const int64_t* v, const int64_t* a, const int64_t* b,
    const uint32_t* config, int64_t* out, uint64_t seed, uint32_t idle, uint32_t stall) {
  auto context = std::make_unique<VerilatedContext>();
  auto top = std::make_unique<Vtop>(context.get());
  Random random(seed);
  std::memcpy(top->config_i.data(), config, sizeof(top->config_i));
  top->rst_ni = 0;
  top->apply_i = 0;
  top->ray_valid_i = 0;
  top->exit_ready_i = 0;
  clock(*top);
  clock(*top);
  top->rst_ni = 1;

  const int64_t patience = 4096;
  for (int64_t waited = 0; top->busy_o; ++waited) {
    if (waited > patience) return -1;
    clock(*top);
  }
  int64_t sent = 0, received = 0, clocks = 0, waited = 0;
  bool offered = false;
  while (received < count) {
    if (!offered && sent < count && !(idle && random.chance(idle))) {
      top->ray_u_i = u[sent] & 0x3ffff;
      top->ray_v_i = v[sent] & 0x3ffff;
      top->ray_a_i = a[sent] & ((1u << LIPPMANN_NEAR) - 1);
      top->ray_b_i = b[sent] & ((1u << LIPPMANN_NEAR) - 1);
      offered = true;
    }
    top->ray_valid_i = offered;
    top->exit_ready_i = !(stall && random.chance(stall));
    // The handshakes of a clock are known before its edge, because they depend only on registers.
    const bool accepted = offered && top->ray_ready_o;
    if (top->exit_valid_o && top->exit_ready_i) {
      int64_t* ray = out + received;
      ray[0] = signed_word(top->exit_i_o, 12);
      ray[count] = signed_word(top->exit_j_o, 12);
      ray[2 * count] = signed_word(top->exit_x_o, LIPPMANN_NEAR + 2);
      ray[3 * count] = signed_word(top->exit_y_o, LIPPMANN_NEAR + 2);
      ray[4 * count] = signed_word(top->exit_z_o, LIPPMANN_NEAR + 2);
      ray[5 * count] = signed_word(top->exit_dx_o, LIPPMANN_NEAR);
      ray[6 * count] = signed_word(top->exit_dy_o, LIPPMANN_NEAR);
      ray[7 * count] = signed_word(top->exit_dz_o, LIPPMANN_NEAR);
      ray[8 * count] = top->exit_status_o;
      ++received;
      waited = 0;
    } else if (++waited > patience) {
      return -1;
    }
    clock(*top);
    ++clocks;
    if (accepted) {
      ++sent;
      offered = false;
    }
  }
  top->final();
  return clocks;
}
