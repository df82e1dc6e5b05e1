// SPDX-License-Identifier: Apache-2.0
/// Checks at the ports of `lipp_fifo` that no word is lost, duplicated or reordered.
///
/// The writer never writes into a full FIFO. Output valid_o is high exactly while a word is stored
/// that was written four or more clocks ago. The n-th word read equals the n-th word written.
///
/// The checks watch one word at a time: the next word written while watch_i is high. In a proof the
/// solver chooses the watched word, so the result is valid for every word.
module lipp_fifo_checks #(
  parameter int Width = 36,
  parameter int AddressBits = 9,
  parameter bit AssumeWriter = 1'b0,  // 1: assume, not assert, the writer's rules
  parameter bit AssumeFifo = 1'b0     // 1: assume, not assert, the FIFO's rules
) (
  input  logic                 clk_i,
  input  logic                 rst_ni,
  input  logic                 write_i,
  input  logic [Width-1:0]     data_i,
  input  logic                 valid_o,
  input  logic                 ready_i,
  input  logic [Width-1:0]     data_o,
  input  logic                 watch_i,
  // The invariants of proofs use these outputs.
  output logic [AddressBits:0] count_o,     // number of words in the FIFO
  output logic [3:0]           wrote_o,     // bit k: a word was written k + 1 clocks ago
  output logic                 watching_o,
  output logic [AddressBits:0] ahead_o,     // number of words before the watched one
  output logic [Width-1:0]     watched_o
);

`ifdef FORMAL
  wire checked = rst_ni;
`else
  reg reset_q = 0;  // 1: a first reset has begun; before it, nothing is checked
  always @(posedge clk_i or negedge rst_ni) if (!rst_ni) reset_q <= 1;
  wire checked = rst_ni && reset_q;
`endif

  localparam int Room = 1 << AddressBits;
  localparam int C = AddressBits + 1;

  wire take = valid_o && ready_i;

  reg [C-1:0] count_q;
  reg [3:0] wrote_q;
  always @(posedge clk_i or negedge rst_ni) begin
    if (!rst_ni) begin
      count_q <= 0;
      wrote_q <= 0;
    end else begin
      count_q <= count_q + C'(write_i) - C'(take);
      wrote_q <= {wrote_q[2:0], write_i};
    end
  end
  wire [2:0] recent = 3'(wrote_q[0]) + 3'(wrote_q[1]) + 3'(wrote_q[2]);

  reg watching_q;
  reg [C-1:0] ahead_q;
  reg [Width-1:0] watched_q, out_q;
  reg stalled_q;
  wire watch = write_i && watch_i && !watching_q;
  always @(posedge clk_i or negedge rst_ni) begin
    if (!rst_ni) begin
      watching_q <= 0;
      stalled_q <= 0;
    end else begin
      watching_q <= watch || (watching_q && !(take && ahead_q == 0));
      stalled_q <= valid_o && !ready_i;
    end
  end
  always @(posedge clk_i) begin
    ahead_q <= (watch ? count_q : ahead_q) - C'(take);
    if (watch) watched_q <= data_i;
    out_q <= data_o;
  end
  assign count_o = count_q;
  assign wrote_o = wrote_q;
  assign watching_o = watching_q;
  assign ahead_o = ahead_q;
  assign watched_o = watched_q;

  wire room_ok = !write_i || count_q < C'(Room);
  wire valid_ok = valid_o == (count_q > C'(recent));
  wire order_ok = !(watching_q && ahead_q == 0 && valid_o) || data_o == watched_q;
  wire stable_ok = !stalled_q || data_o == out_q;
  if (AssumeWriter) begin : gen_assume_writer
    always @(posedge clk_i) if (checked) assume(room_ok);
  end else begin : gen_writer
    always @(posedge clk_i) if (checked) promise: assert(room_ok);
  end
  if (AssumeFifo) begin : gen_assume_fifo
    always @(posedge clk_i) if (checked) assume(valid_ok && order_ok && stable_ok);
  end else begin : gen_fifo
    always @(posedge clk_i) begin
      if (checked) begin
        four_clocks: assert(valid_ok);
        in_order: assert(order_ok);
        stable_data: assert(stable_ok);
      end
    end
  end

  // Proofs of other modules assume these consequences of the FIFO's rules.
  always @(posedge clk_i) begin
    if (checked) begin
      counted: assert(count_q <= C'(Room));
      recent_inside: assert(count_q >= C'(recent) + C'(wrote_q[3]));
      watched_inside: assert(!watching_q || ahead_q < count_q);
    end
  end

endmodule

`ifndef FORMAL  // in simulation, bind the checks to every instance
bind lipp_fifo lipp_fifo_checks #(.Width(Width), .AddressBits(AddressBits)) i_checks (
  .*, .watch_i(1'b1), .count_o(), .wrote_o(), .watching_o(), .ahead_o(), .watched_o()
);
`endif
