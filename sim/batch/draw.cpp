// SPDX-License-Identifier: Apache-2.0
// Batch harness: wraps Verilated `lipp_scene` in a shared library that converts rays to pixels.
//
// On request, rays are offered and pixels are taken with random pauses, so that a comparison of
// results also tests the handshakes. The Python module lippmann.simulation.harness compiles this
// file once for each build of the RTL.
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

struct Scene {
  VerilatedContext context;
  Vtop top{&context};

  // Runs one rising edge of the clock. The model is not evaluated at the falling edge, at which
  // nothing happens.
  void clock() {
    top.clk_i = 1;
    top.eval();
    top.clk_i = 0;
    top.rootp->__Vtrigprevexpr___TOP__clk_i__0 = 0;
  }

  void write(int slot, uint32_t at, uint8_t byte) {
    top.write_i = 1;
    top.write_slot_i = slot;
    top.write_at_i = at;
    top.write_data_i = byte;
  }
};

uint32_t word(int64_t value, int bits) { return value & ((1u << bits) - 1); }

}  // namespace

#define SHOWN extern "C" __attribute__((visibility("default")))

SHOWN Scene* lippmann_scene_new() {
  auto* scene = new Scene;
  Vtop& top = scene->top;
  top.rst_ni = 0;
  top.take_i = top.write_i = top.exit_valid_i = top.pixel_ready_i = 0;
  scene->clock();
  scene->clock();
  top.rst_ni = 1;
  return scene;
}

SHOWN void lippmann_scene_delete(Scene* scene) {
  scene->top.final();
  delete scene;
}

// Writes bytes into a texture slot, one byte per clock.
SHOWN void lippmann_scene_load(Scene* scene, int slot, int64_t count, const uint8_t* bytes) {
  for (int64_t at = 0; at < count; ++at) {
    scene->write(slot, at, bytes[at]);
    scene->clock();
  }
  scene->top.write_i = 0;
}

// Draws a frame of `count` rays. `rays` consists of 9 consecutive arrays of the words i, j, x, y,
// z, dx, dy, dz, status. `config` contains the bits of scene_config_t. `out` receives `pixels`
// triples r, g, b. In each clock the input pauses with a probability of idle / 256, and the output
// with a probability of stall / 256. During the frame the bytes `loaded` are written into slot
// `slot`, if that number is 0 or more. Returns the number of clocks from the first offered ray to
// the last pixel, -1 if no pixel arrives for too long, or -2 if the marks of the frame's first and
// last pixel are wrong.
SHOWN int64_t lippmann_scene_draw(Scene* scene, int64_t count, int64_t pixels, const int64_t* rays,
                                  const uint32_t* config, uint8_t* out, uint64_t seed, uint32_t idle,
                                  uint32_t stall, int slot, int64_t load_count, const uint8_t* loaded) {
  Vtop& top = scene->top;
  Random random(seed);
  const int64_t patience = 4096;
  std::memcpy(top.config_i.data(), config, sizeof(top.config_i));
  top.take_i = 1;
  top.pixel_ready_i = 1;
  scene->clock();
  top.take_i = 0;
  for (int64_t waited = 0; top.busy_o; ++waited) {
    if (waited > patience) return -1;
    scene->clock();
  }
  // Input config_i is inverted while the frame is drawn, to test that the scene uses its copy.
  for (auto& part : top.config_i.m_storage) part = ~part;

  int64_t sent = 0, received = 0, clocks = 0, waited = 0, load_at = 0;
  bool offered = false;
  while (received < pixels) {
    if (!offered && sent < count && !(idle && random.chance(idle))) {
      const int64_t* ray = rays + sent;
      top.exit_i_i = word(ray[0], 12);
      top.exit_j_i = word(ray[count], 12);
      top.exit_x_i = word(ray[2 * count], LIPPMANN_F + 4);
      top.exit_y_i = word(ray[3 * count], LIPPMANN_F + 4);
      top.exit_z_i = word(ray[4 * count], LIPPMANN_F + 4);
      top.exit_dx_i = word(ray[5 * count], LIPPMANN_F + 2);
      top.exit_dy_i = word(ray[6 * count], LIPPMANN_F + 2);
      top.exit_dz_i = word(ray[7 * count], LIPPMANN_F + 2);
      top.exit_status_i = ray[8 * count];
      top.exit_first_i = sent == 0;
      top.exit_last_i = sent == count - 1;
      offered = true;
    }
    top.exit_valid_i = offered;
    top.pixel_ready_i = !(stall && random.chance(stall));
    top.write_i = 0;
    if (slot >= 0 && load_at < load_count && random.chance(160)) {
      scene->write(slot, load_at, loaded[load_at]);
      ++load_at;
    }
    // The handshakes of a clock are known before its edge, because they depend only on registers.
    const bool accepted = offered && top.exit_ready_o;
    if (top.pixel_valid_o && top.pixel_ready_i) {
      out[3 * received] = top.pixel_rgb_o >> 16;
      out[3 * received + 1] = top.pixel_rgb_o >> 8;
      out[3 * received + 2] = top.pixel_rgb_o;
      if (top.pixel_first_o != (received == 0) || top.pixel_last_o != (received == pixels - 1)) return -2;
      ++received;
      waited = 0;
    } else if (++waited > patience) {
      return -1;
    }
    scene->clock();
    ++clocks;
    if (accepted) {
      ++sent;
      offered = false;
    }
  }
  top.exit_valid_i = 0;
  for (; slot >= 0 && load_at < load_count; ++load_at) {
    scene->write(slot, load_at, loaded[load_at]);
    scene->clock();
  }
  top.write_i = 0;
  return clocks;
}
