// SPDX-License-Identifier: Apache-2.0
`default_nettype none

/// Step 6 of the ray trace (plano side to the panel): makes the exit ray from the results of
/// `lipp_leave_dome`.
///
/// Inputs n, cos and s are the results of `lipp_meet_dome`. Input e is the ray's direction in the
/// air, valid in the same clock as n. Input d is the ray's direction in the glass, valid
/// meet_dome_latency(F) clocks before n. A ray that is missed or totally reflected keeps its
/// direction in the glass, rounded to F + 1 fraction bits. Inputs e and d have the number formats
/// of `lipp_enter_flat`. The exit ray's origin is the point on the dome, measured from the vertex:
///
///   x = n_x,   y = n_y,   z = n_z - 1.
///
/// The outputs are valid exit_latency(0, F) clocks after n.
module lipp_exit_dome #(
  parameter int F = 23,
  parameter bit CrossCells = 1'b0,
  localparam int Wt = F + 2 + lipp_optics_pkg::extra_bits(F),
  localparam int Wz = F + 2 + 3 * lipp_optics_pkg::extra_bits(F)
) (
  input  logic                            clk_i,
  input  lipp_optics_pkg::optics_config_t config_i,
  input  logic signed [F+1:0]             nx_i,
  input  logic signed [F+1:0]             ny_i,
  input  logic signed [F+1:0]             nz_i,
  input  logic signed [F+1:0]             cos_i,
  input  logic signed [F+3:0]             s_i,
  input  logic signed [Wt-1:0]            ex_i,
  input  logic signed [Wt-1:0]            ey_i,
  input  logic signed [Wt-1:0]            dx_i,
  input  logic signed [Wt-1:0]            dy_i,
  input  logic signed [Wz-1:0]            dz_i,
  input  logic                            missed_i,
  output logic signed [F+3:0]             x_o,
  output logic signed [F+3:0]             y_o,
  output logic signed [F+3:0]             z_o,
  output logic signed [F+1:0]             dx_o,
  output logic signed [F+1:0]             dy_o,
  output logic signed [F+1:0]             dz_o,
  output logic                            reflected_o,
  output logic                            beyond_o
);
  import lipp_optics_pkg::*;

  localparam int W = F + 2;
  localparam int Wf = W + 2;
  localparam int Latency = exit_latency(1'b0, F);
  // A build for one orientation of the lenslets uses only some fields of config_i.
  logic unused_config;
  assign unused_config = ^config_i;

  logic signed [Wz-1:0] dome_dz;
  logic signed [W-1:0] air_dx, air_dy, air_dz, air_dx_q, air_dy_q, air_dz_q;
  logic reflected, beyond, missed, keep_q;
  logic signed [W-1:0] nx, ny, nz, glass_dx, glass_dy, glass_dz;
  lipp_delay #(.Width(Wz), .Cycles(meet_dome_latency(F))) i_dz (
    .clk_i, .d_i(dz_i), .q_o(dome_dz)
  );
  lipp_leave_dome #(.F(F), .CrossCells(CrossCells)) i_leave_dome (
    .clk_i, .nx_i, .ny_i, .nz_i, .cos_i, .s_i, .ex_i, .ey_i, .dz_i(dome_dz),
    .index_i(config_i.index[W:0]), .index_square_i(config_i.index_square[Wf-1:0]),
    .dx_o(air_dx), .dy_o(air_dy), .dz_o(air_dz), .reflected_o(reflected), .beyond_o(beyond)
  );
  lipp_delay #(.Width(3 * W), .Cycles(Latency)) i_n (
    .clk_i, .d_i({nx_i, ny_i, nz_i}), .q_o({nx, ny, nz})
  );
  logic signed [W-1:0] round_dx_q, round_dy_q, round_dz_q;
  logic [Wz-1:0] round_dz;
  assign round_dz = (dz_i + Wz'((1 << (Wz - W)) >> 1)) >> (Wz - W);
  always_ff @(posedge clk_i) begin
    round_dx_q <= W'((dx_i + Wt'(Wt - W)) >>> (Wt - W));
    round_dy_q <= W'((dy_i + Wt'(Wt - W)) >>> (Wt - W));
    // The value 1 does not fit the word of dz, so dz is limited to the maximum.
    round_dz_q <= round_dz[W-1] ? {1'b0, {(W - 1){1'b1}}} : round_dz[W-1:0];
  end
  lipp_delay #(.Width(3 * W), .Cycles(meet_dome_latency(F) + Latency - 1)) i_glass (
    .clk_i, .d_i({round_dx_q, round_dy_q, round_dz_q}), .q_o({glass_dx, glass_dy, glass_dz})
  );
  lipp_delay #(.Width(1), .Cycles(Latency - 1)) i_missed (
    .clk_i, .d_i(missed_i), .q_o(missed)
  );
  always_ff @(posedge clk_i) begin
    keep_q <= reflected || missed;
    {reflected_o, beyond_o} <= {reflected, beyond};
    {air_dx_q, air_dy_q, air_dz_q} <= {air_dx, air_dy, air_dz};
  end
  assign x_o = Wf'(nx);
  assign y_o = Wf'(ny);
  assign z_o = Wf'(nz) - (Wf'(1) <<< (F + 1));
  assign {dx_o, dy_o, dz_o} =
      keep_q ? {glass_dx, glass_dy, glass_dz} : {air_dx_q, air_dy_q, air_dz_q};

endmodule

`default_nettype wire
