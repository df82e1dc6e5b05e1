// SPDX-License-Identifier: Apache-2.0
`default_nettype none

/// Top for a place-and-route trial of `lipp_ray_stream`, surrounded by registers like `probe`'s.
///
/// Every input of `lipp_ray_stream` comes from a register, and every output is combined into a
/// register. Therefore no logic is optimised away, and no timing path ends at a pin.
module probe_top #(
  parameter lipp_optics_pkg::build_t Build = lipp_optics_pkg::ExactSquare,
  localparam int F = int'(Build.fraction_bits)
) (
  input  logic clk_i,
  input  logic rst_ni,
  input  logic bit_i,
  output logic bit_o
);
  import lipp_optics_pkg::*;

  localparam int W = F + 2;
  localparam int ConfigBits = $bits(optics_config_t);
  localparam int RayBits = 2 * PixelBits + 2 * W;
  localparam int OutBits = 2 * IndexBits + 3 * (W + 2) + 3 * W + 3;

  // Synthesis keeps these names, so that the report can tell these registers from the design's.
  (* keep *) logic [1:0] reset_q;  // high in reset, because the FPGA's cells need this polarity
  (* keep *) logic [ConfigBits-1:0] config_q;
  (* keep *) logic [RayBits-1:0] ray_q;
  (* keep *) logic apply_q, valid_q, ready_q;
  logic ready, valid, busy, idle;
  logic [OutBits-1:0] out;
  (* keep *) logic [OutBits+3:0] out_q, fold_q;
  ray_status_e status;
  always_ff @(posedge clk_i or negedge rst_ni) begin
    if (!rst_ni) reset_q <= '1;
    else reset_q <= {reset_q[0], 1'b0};
  end
  always_ff @(posedge clk_i) begin
    config_q <= {config_q[ConfigBits-2:0], bit_i};
    ray_q <= {ray_q[RayBits-2:0], config_q[ConfigBits-1]};
    {apply_q, valid_q, ready_q} <= {valid_q, ready_q, ray_q[RayBits-1]};
    out_q <= {idle, busy, ready, valid, out};
    fold_q <= out_q ^ {fold_q[OutBits+2:0], 1'b0};
    bit_o <= fold_q[OutBits+3];
  end

  lipp_ray_stream #(.Build(Build)) i_lenslet (
    .clk_i, .rst_ni(!reset_q[1]), .config_i(config_q), .apply_i(apply_q), .busy_o(busy),
    .idle_o(idle), .ray_valid_i(valid_q), .ray_ready_o(ready),
    .ray_u_i(ray_q[2*W+PixelBits+:PixelBits]), .ray_v_i(ray_q[2*W+:PixelBits]),
    .ray_a_i(ray_q[W+:W]), .ray_b_i(ray_q[0+:W]),
    .exit_valid_o(valid), .exit_ready_i(ready_q),
    .exit_i_o(out[OutBits-1-:IndexBits]), .exit_j_o(out[OutBits-IndexBits-1-:IndexBits]),
    .exit_x_o(out[3+3*W+2*(W+2)+:W+2]), .exit_y_o(out[3+3*W+(W+2)+:W+2]),
    .exit_z_o(out[3+3*W+:W+2]),
    .exit_dx_o(out[3+2*W+:W]), .exit_dy_o(out[3+W+:W]), .exit_dz_o(out[3+:W]),
    .exit_status_o(status)
  );
  assign out[2:0] = status;

endmodule

`default_nettype wire
