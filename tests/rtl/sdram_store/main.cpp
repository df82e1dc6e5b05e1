// The store over a chip of SDRAM, with random clients or a panel, each pixel compared.
//
//   store KEY=VALUE ...   prints KEY=VALUE of what was seen, and exits 1 when something was wrong
//
// Clients: `show`, `write` and `read` make random requests of random lengths, with random pauses in
// their streams, until `pixels` pixels were moved. With `panel=FRAMES`, show is a panel of 720p's
// porches that takes a pixel in each active clock; read checks the whole buffers, row by row of
// tiles copied from one to the other in between; write gets what is copied, and tiles at line rate.
//
// A word read must be one that the write client wrote there: the one that was last done when the
// read was taken, or a later one. In the end all contents are read once more.
#include <algorithm>
#include <cstdio>
#include <cstdlib>
#include <map>
#include <memory>
#include <string>
#include <vector>

#include "Vtop.h"
#include "../../../sim/board/sdram.h"
#include "verilated.h"

namespace {

class Random {
 public:
  explicit Random(uint64_t seed) : state_(seed * 2 + 1) {}
  uint32_t next() {
    state_ ^= state_ >> 12;
    state_ ^= state_ << 25;
    state_ ^= state_ >> 27;
    return static_cast<uint32_t>(state_ * 2685821657736338717ULL >> 32);
  }
  uint32_t below(uint32_t n) {
    return static_cast<uint32_t>(static_cast<uint64_t>(next()) * n >> 32);
  }

 private:
  uint64_t state_;
};

std::map<std::string, uint64_t> arguments;
uint64_t argument(const char* name, uint64_t otherwise) {
  auto found = arguments.find(name);
  return found == arguments.end() ? otherwise : found->second;
}

uint64_t wrong = 0;
void error(const char* what, uint64_t when, uint64_t a, uint64_t b) {
  if (++wrong <= 10)
    std::printf("error: %s at clock %llu: %llu, %llu\n", what, (unsigned long long)when,
                (unsigned long long)a, (unsigned long long)b);
}

// ---- what is in the buffers ----

int kPast = 16;  // writes of a pixel that are remembered
struct Past {
  uint32_t rgb = 0;
  uint64_t done = 0;  // clock, or ~0 while it is being written
};
struct Contents {
  explicit Contents(size_t pixels)
      : past(pixels * 2 * kPast), newest(pixels * 2, 0), pixels(pixels) {}
  size_t at(int buffer, size_t place) const { return buffer * pixels + place; }
  void begin(size_t at, uint32_t rgb) {
    newest[at] = (newest[at] + 1) % kPast;
    past[at * kPast + newest[at]] = {rgb, ~0ull};
  }
  void done(size_t at, uint64_t clock) { past[at * kPast + newest[at]].done = clock; }
  uint32_t last(size_t at) const { return past[at * kPast + newest[at]].rgb; }
  // Each word by itself: one that is written meanwhile may be older or newer than its neighbour.
  bool legal(size_t at, uint32_t rgb, uint64_t since) const {
    const uint32_t high = at % 2 ? 0xff0000 : 0xffff00;
    bool high_seen = false, low_seen = false;
    for (int k = 0; k < kPast; ++k) {
      const Past& one = past[at * kPast + (newest[at] + kPast - k) % kPast];
      high_seen = high_seen || ((one.rgb ^ rgb) & high) == 0;
      low_seen = low_seen || ((one.rgb ^ rgb) & ~high & 0xffffff) == 0;
      if (one.done < since) break;  // the ones before were overwritten
    }
    return high_seen && low_seen;
  }
  std::vector<Past> past;
  std::vector<uint8_t> newest;
  size_t pixels;
};

// ---- clients ----

// How often a stream moves, in 256; changes by and by.
struct Pace {
  uint32_t share = 256;
  uint64_t until = 0;
  bool active(Random& random, uint64_t clock) {
    if (clock >= until) {
      static const uint32_t kShares[] = {256, 256, 200, 128, 40, 4, 0};
      share = kShares[random.below(7)];
      until = clock + 1 + random.below(share == 0 ? 400 : 3000);
    }
    return share == 256 || (random.next() >> 24) < share;
  }
};

struct Request {
  int buffer = 0;
  size_t first = 0, count = 0;
};

struct Reader {
  bool offered = false, reading = false, ready = false;
  bool stalled = false;
  uint32_t held = 0;
  Request request;
  size_t got = 0;
  uint64_t since = 0, pixels = 0, requests = 0, waited = 0;
  Pace pace;
};

struct Writer {
  bool offered = false, writing = false, valid = false;
  Request request;
  size_t sent = 0;
  std::vector<uint32_t> rgb;
  uint64_t pixels = 0, requests = 0, waited = 0;
  Pace pace;
};

size_t panel_width, panel_height;

Request any_request(Random& random, size_t pixels, size_t most) {
  Request request;
  request.buffer = random.below(2);
  // Short ones and long ones alike.
  const size_t limit = std::min<size_t>(pixels, 2u << random.below(20));
  request.count = 2 + 2 * random.below(static_cast<uint32_t>(std::min(limit, most) / 2));
  request.count = std::min(request.count, std::min(pixels, most));
  request.first = 2 * random.below(static_cast<uint32_t>((pixels - request.count) / 2 + 1));
  return request;
}

}  // namespace

int main(int argc, char** argv) {
  auto context = std::make_unique<VerilatedContext>();
  context->commandArgs(argc, argv);
  for (int k = 1; k < argc; ++k) {
    const std::string text = argv[k];
    const size_t equals = text.find('=');
    if (equals != std::string::npos)
      arguments[text.substr(0, equals)] = std::strtoull(text.c_str() + equals + 1, nullptr, 10);
  }
  panel_width = argument("width", 64);
  panel_height = argument("height", 48);
  const size_t pixels = panel_width * panel_height;
  if (pixels > 100'000) kPast = 4;
  const uint64_t board_ps = argument("board_ps", 13333), mem_ps = argument("mem_ps", 8000);
  const uint64_t wanted = argument("pixels", 20000), frames = argument("panel", 0);
  const uint64_t resets = argument("resets", 0);
  const unsigned pad =
      static_cast<unsigned>(argument("pad", 0));  // registers on the way out; as many in
  SdramGrade grade = argument("grade", 75) == 7   ? kGrade7E
                     : argument("grade", 75) == 6 ? kGrade6A
                                                  : kGrade75;
  // Another chip than the controller's parameters are for.
  grade.ck3 = argument("ck", grade.ck3);
  grade.rcd = argument("rcd", grade.rcd);
  grade.rp = argument("rp", grade.rp);
  grade.ras = argument("ras", grade.ras);
  grade.rc = argument("rc", grade.rc);
  grade.rfc = argument("rfc", grade.rfc);
  grade.rrd = argument("rrd", grade.rrd);
  grade.wr = argument("wr", grade.wr);
  grade.mrd_clocks = argument("mrd_clocks", grade.mrd_clocks);
  grade.power_up = argument("power_up", grade.power_up);
  grade.refresh = argument("refresh", grade.refresh);
  grade.rows = static_cast<unsigned>(argument("rows", grade.rows));
  Random random(argument("seed", 1));

  auto top = std::make_unique<Vtop>(context.get());
  Sdram chip(grade);
  Contents contents(pixels);
  Reader show, read;
  Writer write;
  SdramPins pads[4];
  uint16_t pads_in[4] = {};

  // ---- the panel ----
  const size_t h_total = panel_width + 370, v_blank = argument("v_blank", 1);
  uint64_t pixel_x = 0, pixel_y = 0, shown = 0, underflows = 0;
  bool begun = false;  // a frame's pixels were asked for and the panel has begun
  int front = 0;
  // The copy: rows of 32 pixels read from the front buffer and written to the other.
  uint64_t copied = 0, checked = 0, next_tile = 0, rows_copied = 0;
  bool copying = false, copy_ready = false;
  std::vector<uint32_t> row;
  Request copy;
  // Words of the chip while the panel is on.
  uint64_t window_clocks = 0, window_reads = 0, window_writes = 0, window_refreshes = 0,
           window_show = 0, window_read = 0;
  uint64_t window_write = 0, window_activations = 0;

  // Every pixel is written once at first, row by row.
  size_t fill = 0;
  const size_t step = std::min<size_t>(pixels, 32);
  bool filled = false, closing = false;
  uint64_t reset_at = resets ? 150'000'000 / board_ps + random.below(20000) : ~0ull,
           resets_done = 0, in_reset = 4;
  int final_buffer = 0;

  uint64_t clock = 0, mem_clock = 0;
  uint64_t board_at = 100'000 + random.below(static_cast<uint32_t>(board_ps)), mem_at = 100'000;
  const uint64_t patience = 400'000'000 / board_ps;  // longer than the initialisation
  top->clk_i = top->mem_clk_i = 0;
  for (int level : {1, 0}) {  // a reset begins with its edge
    top->rst_ni = level;
    top->eval();
  }
  bool finished = false;

  auto forget = [&] {
    show.offered = show.reading = show.ready = show.stalled = false;
    read.offered = read.reading = read.ready = read.stalled = false;
    write.offered = write.writing = write.valid = false;
    // Contents may be lost: all is written again.
    filled = false;
    fill = 0;
    copying = copy_ready = begun = false;
  };

  // A rising edge of the board's clock: looks at what the store shows before it.
  auto reader_edge = [&](Reader& r, bool ready_o, bool valid_o, uint32_t rgb, const char* name,
                         bool is_show) {
    ++r.waited;
    if (r.offered && ready_o) {
      r.offered = false;
      r.reading = true;
      r.since = clock;
      r.got = 0;
      r.waited = 0;
      ++r.requests;
    } else if (r.reading && ready_o) {
      error(name, clock, 1, r.got);  // it is ready while it should be busy
    }
    if (r.stalled && (!valid_o || rgb != r.held))
      error("a pixel changed during a stall", clock, r.held, rgb);
    r.stalled = valid_o && !r.ready;
    r.held = rgb;
    if (valid_o && !r.reading) error("a pixel without a request", clock, rgb, 0);
    if (valid_o && r.ready && r.reading) {
      const size_t at = contents.at(r.request.buffer, r.request.first + r.got);
      if (!contents.legal(at, rgb, r.since)) error(name, clock, rgb, contents.last(at));
      ++r.got;
      ++r.pixels;
      r.waited = 0;
      if (!is_show && copying) {
        row.push_back(rgb);
        if (r.got == r.request.count) {
          copying = false;
          copy_ready = true;
          copied += row.size();
        }
      }
      if (r.got == r.request.count) r.reading = false;
    }
    if ((r.offered || (r.reading && r.ready)) && r.waited > patience) {
      error("nothing moves", clock, r.got, r.request.count);
      r.waited = 0;
      finished = true;
    }
  };

  while (!finished && wrong < 100) {
    if (board_at <= mem_at) {
      // ---- the board's clock ----
      context->time(board_at);
      ++clock;
      reader_edge(show, top->show_ready_o, top->show_pixel_valid_o, top->show_rgb_o, "show", true);
      reader_edge(read, top->read_ready_o, top->read_pixel_valid_o, top->read_rgb_o, "read", false);
      ++write.waited;
      if (write.offered && top->write_ready_o) {
        write.offered = false;
        write.writing = true;
        write.waited = 0;
        ++write.requests;
        for (size_t k = 0; k < write.request.count; ++k)
          contents.begin(contents.at(write.request.buffer, write.request.first + k), write.rgb[k]);
      } else if (write.writing && top->write_ready_o) {
        error("write is ready while it is busy", clock, 0, 0);
      }
      if (write.valid && top->write_pixel_ready_o) {
        if (!write.writing || write.sent == write.request.count)
          error("a pixel too many is taken", clock, write.sent, 0);
        ++write.sent;
        ++write.pixels;
        write.valid = false;
        write.waited = 0;
      }
      if (top->write_done_o) {
        if (!write.writing || write.sent != write.request.count)
          error("done too early", clock, write.sent, write.request.count);
        write.writing = false;
        write.waited = 0;
        for (size_t k = 0; k < write.request.count; ++k)
          contents.done(contents.at(write.request.buffer, write.request.first + k), clock);
      }
      if ((write.offered || write.writing) && write.waited > patience) {
        error("write does not move", clock, write.sent, write.request.count);
        finished = true;
      }

      // ---- the panel's next clock ----
      bool want = false;
      if (frames && begun) {
        const bool active = pixel_x < panel_width && pixel_y < panel_height;
        if (active && !top->show_pixel_valid_o) ++underflows;
        if (++pixel_x == h_total) {
          pixel_x = 0;
          ++pixel_y;
          if (pixel_y == panel_height) ++shown;
          if (pixel_y == panel_height + v_blank) pixel_y = 0;
        }
        if (shown == frames) {
          begun = false;
          window_clocks = mem_clock - window_clocks;
          window_reads = chip.reads() - window_reads;
          window_writes = chip.writes() - window_writes;
          window_refreshes = chip.refreshes() - window_refreshes;
          window_activations = chip.activations() - window_activations;
          window_show = show.pixels - window_show;
          window_read = read.pixels - window_read;
          window_write = write.pixels - window_write;
        }
      }

      const bool rising = !in_reset;
      top->clk_i = 1;
      top->eval();
      top->clk_i = 0;

      // ---- what the clients do in the next clock ----
      const uint64_t moved = show.pixels + read.pixels + write.pixels;
      const bool enough = frames ? shown >= frames : moved >= wanted;
      if (in_reset) {
        if (--in_reset == 0) top->rst_ni = 1;
      } else if (resets_done < resets && clock >= reset_at) {
        top->rst_ni = 0;
        in_reset = 1 + random.below(5);
        ++resets_done;
        reset_at = clock + 150'000'000 / board_ps + random.below(30000);
        forget();
      }
      if (rising && !in_reset) {
        // Write: the first contents, then what there is to write.
        if (!write.offered && !write.writing) {
          if (!filled) {
            const int buffer = fill >= pixels;
            const size_t first = fill % pixels;
            if (fill == 2 * pixels) {
              filled = true;
            } else {
              write.request = {buffer, first, std::min(step, pixels - first)};
              write.rgb.clear();
              for (size_t k = 0; k < write.request.count; ++k)
                write.rgb.push_back(random.next() & 0xffffff);
              fill += write.request.count;
              write.offered = true;
              write.sent = 0;
            }
          } else if (frames && begun && copy_ready) {
            write.request = copy;
            write.rgb = row;
            write.offered = true;
            write.sent = 0;
            copy_ready = false;
            ++rows_copied;
          } else if (frames && begun && clock >= next_tile) {
            write.request = {1 - front, 32 * random.below(static_cast<uint32_t>(pixels / 32)), 32};
            write.rgb.clear();
            for (size_t k = 0; k < 32; ++k) write.rgb.push_back(random.next() & 0xffffff);
            write.offered = true;
            write.sent = 0;
            next_tile += 320'000'000 / board_ps;  // 100,000 pixels a second
          } else if (!frames && !enough && random.below(8) == 0) {
            write.request = any_request(random, pixels, 64);
            write.rgb.clear();
            for (size_t k = 0; k < write.request.count; ++k)
              write.rgb.push_back(random.next() & 0xffffff);
            write.offered = true;
            write.sent = 0;
          }
        }
        // The first pixel may be there before its request was taken.
        if ((write.offered || write.writing) && !write.valid && write.sent < write.request.count)
          write.valid = frames || !filled || write.pace.active(random, clock);
        // Read.
        if (filled && !read.offered && !read.reading) {
          if (enough) {
            if (!write.offered && !write.writing && !closing) closing = true;
            if (closing && final_buffer < 2) {
              read.request = {final_buffer++, 0, pixels};
              read.offered = true;
            } else if (closing && !show.reading && !show.offered) {
              finished = true;
            }
          } else if (frames) {
            if (begun && !copy_ready && !write.offered && !write.writing && random.below(2) == 0) {
              copy = {1 - front, 32 * random.below(static_cast<uint32_t>(pixels / 32)), 32};
              read.request = {front, copy.first, 32};
              row.clear();
              copying = true;
              read.offered = true;
            } else if (begun) {
              // A part of the check: so the copy is not behind a whole frame here.
              read.request = {1 - front, checked % pixels, std::min<size_t>(pixels, 1280)};
              if (read.request.first + read.request.count > pixels) read.request.first = 0;
              checked += read.request.count;
              read.offered = true;
            }
          } else if (random.below(8) == 0) {
            read.request = any_request(random, pixels, pixels);
            read.offered = true;
          }
        }
        // Show.
        if (filled && !show.offered && !show.reading && !enough) {
          if (frames) {
            show.request = {front, 0, pixels};
            show.offered = true;
          } else if (random.below(8) == 0) {
            show.request = any_request(random, pixels, pixels);
            show.offered = true;
          }
        }
        if (frames && !begun && show.reading && top->show_pixel_valid_o && !enough) {
          // The line buffer has had its time: the panel's first pixel comes in a line.
          begun = true;
          pixel_x = 0;
          pixel_y = panel_height;
          next_tile = clock;
          window_clocks = mem_clock;
          window_reads = chip.reads();
          window_writes = chip.writes();
          window_refreshes = chip.refreshes();
          window_activations = chip.activations();
          window_show = show.pixels;
          window_read = read.pixels;
          window_write = write.pixels;
        }
        if (frames && begun) want = pixel_x < panel_width && pixel_y < panel_height;
      }
      show.ready = frames ? want || enough : show.pace.active(random, clock);
      read.ready = frames || closing || read.pace.active(random, clock);

      top->show_valid_i = show.offered;
      top->show_buffer_i = show.request.buffer;
      top->show_first_i = static_cast<uint32_t>(show.request.first);
      top->show_count_i = static_cast<uint32_t>(show.request.count);
      top->show_pixel_ready_i = show.ready;
      top->read_valid_i = read.offered;
      top->read_buffer_i = read.request.buffer;
      top->read_first_i = static_cast<uint32_t>(read.request.first);
      top->read_count_i = static_cast<uint32_t>(read.request.count);
      top->read_pixel_ready_i = read.ready;
      top->write_valid_i = write.offered;
      top->write_buffer_i = write.request.buffer;
      top->write_first_i = static_cast<uint32_t>(write.request.first);
      top->write_count_i = static_cast<uint32_t>(write.request.count);
      top->write_pixel_valid_i = write.valid;
      top->write_rgb_i = write.valid ? write.rgb[write.sent] : random.next() & 0xffffff;
      top->eval();
      board_at += board_ps;
    } else {
      // ---- the memory's clock: the chip's is the same ----
      context->time(mem_at);
      ++mem_clock;
      SdramPins pins;
      pins.cke = top->cke_o;
      pins.cs_n = top->cs_no;
      pins.ras_n = top->ras_no;
      pins.cas_n = top->cas_no;
      pins.we_n = top->we_no;
      pins.ba = top->ba_o;
      pins.a = top->a_o;
      pins.dqm = top->dqm_o;
      pins.dq = top->dq_o;
      pins.oe = top->dq_oe_o;
      // What nobody drives is noise. Registers of the pads: `pad` of them on the way out, and in.
      const int driven = chip.driving();
      const uint16_t lanes = (driven & 1 ? 0xff : 0) | (driven & 2 ? 0xff00 : 0);
      const uint16_t dq =
          (chip.dq() & lanes) | (static_cast<uint16_t>(mem_clock * 40503u) & ~lanes);
      top->dq_i = pad ? pads_in[pad - 1] : dq;
      for (unsigned k = pad; k-- > 1;) pads_in[k] = pads_in[k - 1];
      pads_in[0] = dq;
      top->mem_clk_i = 1;
      top->eval();
      // An edge resets what Verilator's reset, which needs one, has not: the chip is there after
      // it.
      if (mem_clock > 2) chip.edge(mem_at, pad ? pads[pad - 1] : pins);
      for (unsigned k = pad; k-- > 1;) pads[k] = pads[k - 1];
      pads[0] = pins;
      top->mem_clk_i = 0;
      top->eval();
      mem_at += mem_ps;
    }
  }
  top->final();

  for (const auto& [name, count] : chip.violations())
    std::printf("violation: %s: %llu, the first at %llu ps\n", name.c_str(),
                (unsigned long long)count, (unsigned long long)chip.first_violation());
  auto print = [](const char* name, uint64_t value) {
    std::printf("%s=%llu\n", name, (unsigned long long)value);
  };
  print("errors", wrong);
  print("violations", chip.violations().size());
  print("clocks", clock);
  print("memory_clocks", mem_clock);
  print("refreshes", chip.refreshes());
  print("words_read", chip.reads());
  print("words_written", chip.writes());
  print("activations", chip.activations());
  print("show_pixels", show.pixels);
  print("write_pixels", write.pixels);
  print("read_pixels", read.pixels);
  print("show_requests", show.requests);
  print("write_requests", write.requests);
  print("read_requests", read.requests);
  print("resets", resets_done);
  if (frames) {
    print("frames", shown);
    print("underflows", underflows);
    print("rows_copied", rows_copied);
    print("window_clocks", window_clocks);
    print("window_words_read", window_reads);
    print("window_words_written", window_writes);
    print("window_refreshes", window_refreshes);
    print("window_activations", window_activations);
    print("window_show_pixels", window_show);
    print("window_read_pixels", window_read);
    print("window_write_pixels", window_write);
  }
  return wrong || !chip.violations().empty() || underflows ? 1 : 0;
}
