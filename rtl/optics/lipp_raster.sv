// SPDX-License-Identifier: Apache-2.0
`default_nettype none

/// Scans a window of the panel row by row, and outputs a ray per clock with a valid/ready
/// handshake.
///
/// Input start_i copies config_i and starts a frame with `samples` rays for each pixel. Input
/// start_i is ignored while running_o is high. A window that is empty or extends beyond the panel
/// is refused; refused_o is then high until the next start. Output running_o is high until the
/// frame's last ray was accepted. Input abort_i ends the frame: no ray is offered from the next
/// clock on, and a start in the clock of abort_i is ignored.
///
/// The ray of pixel (c, r), counted from the panel's top left, has the coordinates
///
///   u = 8 (2 c + 1 - width) + du,  v = 8 (height - 2 r - 1) + dv
///   a = 2^(F-10) ja,               b = 2^(F-10) jb,
///
/// where u and v have 4 fraction bits. Field `jitter` selects a ray's offsets (du, dv, ja, jb):
///
///   JitterOff    0
///   JitterTable  entry (table_first + sample) mod 64
///   JitterLfsr   the ray's random word, read as an entry, with bits 11 and 10 of ja and of jb
///                replaced by their bit 9, so that a and b are in [-1/2, 1/2).
///
/// The random words are states of a Galois LFSR with the primitive polynomial x^32 + x^22 + x^2 + x
/// + 1; bit k is the coefficient of x^k. The frame's first ray uses the seed; seed 0 counts as 1.
/// The word of each further ray is 32 LFSR steps after the word of the ray before it.
module lipp_raster #(
  parameter int F = 23
) (
  input  logic                                    clk_i,
  input  logic                                    rst_ni,

  input  lipp_optics_pkg::raster_config_t config_i,  // settings of the next frame
  input  logic                            start_i,  // pulse: starts a frame
  input  logic                            abort_i,  // pulse: ends the current frame
  output logic                            running_o,  // 1: the frame is not complete
  output logic                            refused_o,  // 1: the window was refused

  input  logic [3:0]                            table_write_i,  // write enable of each byte
  input  logic [lipp_optics_pkg::TableBits-1:0] table_at_i,  // index of the written entry
  input  lipp_optics_pkg::jitter_t              table_entry_i,

  output logic                                         ray_valid_o,
  input  logic                                         ray_ready_i,
  output logic signed [lipp_optics_pkg::PixelBits-1:0] ray_u_o,  // pixel u in 1/16 pixel, rightward
  output logic signed [lipp_optics_pkg::PixelBits-1:0] ray_v_o,  // pixel v in 1/16 pixel, upward
  output logic signed [F+1:0]                          ray_a_o,  // aperture point a, 2^-F pitches
  output logic signed [F+1:0]                          ray_b_o,  // aperture point b, 2^-F rows
  output logic                                         ray_first_o,  // 1: first ray of its frame
  output logic                                         ray_last_o  // 1: last ray of its frame
);
  import lipp_optics_pkg::*;

  localparam int W = F + 2;
  localparam int HalfBits = PanelBits + 1;  // width of pixel coordinates in half-pixels

  if (F < 14 || F > 23) begin : gen_illegal_f
    $fatal(1, "lipp_raster: F must be 14 to 23");
  end

  function automatic logic [31:0] next_random(logic [31:0] state);
    for (int k = 0; k < 32; k++) state = (state << 1) ^ (state[31] ? 32'h0040_0007 : 32'h0);
    return state;
  endfunction

  // ---- copy and check the frame's settings, and compute the first position ----
  raster_config_t config_q;
  logic take, check_q, begin_q, legal, walk_q, step, done, end_of_frame;
  logic [3:0] legal_q;
  // Each counter contains the remaining count minus 2, so the counter is negative at the last item.
  logic signed [16:0] samples_q;
  logic signed [HalfBits-1:0] columns_q, rows_q;
  logic signed [HalfBits-1:0] first_half_u_q, first_half_v_q;
  assign take = start_i && !running_o;
  assign legal = &legal_q;
  assign done = ray_valid_o && ray_ready_i && ray_last_o;
  always_ff @(posedge clk_i) begin
    if (take) begin
      config_q <= config_i;
      if (config_i.seed == '0) config_q.seed <= 32'd1;
    end
    legal_q <= {
      config_q.first_column <= config_q.last_column, config_q.last_column < config_q.width,
      config_q.first_row <= config_q.last_row, config_q.last_row < config_q.height
    };
    samples_q <= {config_q.samples == '0, config_q.samples} - 17'd2;
    columns_q <= {1'b0, config_q.last_column} - {1'b0, config_q.first_column} - HalfBits'(1);
    rows_q <= {1'b0, config_q.last_row} - {1'b0, config_q.first_row} - HalfBits'(1);
    first_half_u_q <= {config_q.first_column, 1'b1} - HalfBits'(config_q.width);
    first_half_v_q <= HalfBits'(config_q.height) - {config_q.first_row, 1'b1};
  end
  always_ff @(posedge clk_i or negedge rst_ni) begin
    if (!rst_ni) begin
      {running_o, refused_o, check_q, begin_q, walk_q} <= '0;
    end else begin
      {begin_q, check_q} <= abort_i ? '0 : {check_q, take};
      if (abort_i) running_o <= 1'b0;
      else if (take) {running_o, refused_o} <= 2'b10;
      else if (begin_q && !legal) {running_o, refused_o} <= 2'b01;
      else if (done) running_o <= 1'b0;
      if (abort_i) walk_q <= 1'b0;
      else if (begin_q) walk_q <= legal;
      else if (step && end_of_frame) walk_q <= 1'b0;
    end
  end

  // ---- scan the window: count the remaining samples, columns and rows ----
  logic signed [16:0] samples_left_q;
  logic signed [HalfBits-1:0] columns_left_q, rows_left_q;
  logic signed [HalfBits-1:0] half_u_q, half_v_q;
  logic [TableBits-1:0] entry_at_q;
  logic [31:0] random_q;
  logic first_q, end_of_pixel, end_of_row;
  assign end_of_pixel = samples_left_q < 0;
  assign end_of_row = end_of_pixel && columns_left_q < 0;
  assign end_of_frame = end_of_row && rows_left_q < 0;

  always_ff @(posedge clk_i) begin
    if (begin_q) begin
      samples_left_q <= samples_q;
      columns_left_q <= columns_q;
      rows_left_q <= rows_q;
      {half_u_q, half_v_q} <= {first_half_u_q, first_half_v_q};
      entry_at_q <= config_q.table_first;
      random_q <= config_q.seed;
      first_q <= 1'b1;
    end else if (step) begin
      samples_left_q <= samples_left_q - 17'd1;
      entry_at_q <= entry_at_q + TableBits'(1);
      random_q <= next_random(random_q);
      first_q <= 1'b0;
      if (end_of_pixel) begin
        samples_left_q <= samples_q;
        entry_at_q <= config_q.table_first;
        columns_left_q <= columns_left_q - HalfBits'(1);
        half_u_q <= half_u_q + HalfBits'(2);
      end
      if (end_of_row) begin
        columns_left_q <= columns_q;
        half_u_q <= first_half_u_q;
        rows_left_q <= rows_left_q - HalfBits'(1);
        half_v_q <= half_v_q - HalfBits'(2);
      end
    end
  end

  // ---- select the jitter of the ray ----
  (* ram_style = "distributed" *)
  jitter_t jitter_table[1 << TableBits];
  jitter_t entry_q, drawn_q, jitter_q;
  logic [2:1] valid_q, ray_first_q, ray_last_q;
  logic signed [2:1][HalfBits-1:0] half_u_late_q, half_v_late_q;
  always_ff @(posedge clk_i) begin
    for (int k = 0; k < 4; k++) begin
      if (table_write_i[k]) jitter_table[table_at_i][8*k+:8] <= table_entry_i[8*k+:8];
    end
    if (step) begin
      entry_q <= jitter_table[entry_at_q];
      drawn_q <= '0;
      if (config_q.jitter == JitterLfsr) begin
        drawn_q <= {{3{random_q[29]}}, random_q[28:20], {3{random_q[17]}}, random_q[16:8],
                    random_q[7:0]};
      end
      jitter_q <= config_q.jitter == JitterTable ? entry_q : drawn_q;
      half_u_late_q <= {half_u_late_q[1], half_u_q};
      half_v_late_q <= {half_v_late_q[1], half_v_q};
      ray_first_q <= {ray_first_q[1], first_q};
      ray_last_q <= {ray_last_q[1], end_of_frame};
    end
  end

  // ---- output rays through a skid buffer, whose ready signal is a register ----
  logic signed [PixelBits-1:0] ray_u, ray_v;
  logic signed [11:0] aim_a, aim_b;
  assign ray_u = {half_u_late_q[2], 3'b0} + PixelBits'(jitter_q.du);
  assign ray_v = {half_v_late_q[2], 3'b0} + PixelBits'(jitter_q.dv);
  lipp_skid_buffer #(.Width(2 * PixelBits + 2 * 12 + 2)) i_buffer (
    .clk_i, .rst_ni, .clear_i(abort_i), .in_valid_i(valid_q[2]), .in_ready_o(step),
    .in_data_i({ray_u, ray_v, jitter_q.a, jitter_q.b, ray_first_q[2], ray_last_q[2]}),
    .out_valid_o(ray_valid_o), .out_ready_i(ray_ready_i),
    .out_data_o({ray_u_o, ray_v_o, aim_a, aim_b, ray_first_o, ray_last_o})
  );
  assign ray_a_o = W'(aim_a) <<< (F - 10);
  assign ray_b_o = W'(aim_b) <<< (F - 10);
  always_ff @(posedge clk_i or negedge rst_ni) begin
    if (!rst_ni) valid_q <= '0;
    else if (abort_i) valid_q <= '0;
    else if (step) valid_q <= {valid_q[1], walk_q};
  end

endmodule

`default_nettype wire
