// SPDX-License-Identifier: Apache-2.0
/// Checks the handshake and the marks of the rays at the output of `lipp_raster`.
///
/// An offered ray is stable until it is accepted or aborted. Exactly the first ray of a frame is
/// marked as first. Output running_o is high from the offer of the first ray of a frame until the
/// last ray is accepted or the frame is aborted.
module lipp_raster_checks #(
  parameter int F = 23
) (
  input logic                                    clk_i,
  input logic                                    rst_ni,
  input logic                                    abort_i,
  input logic                                    running_o,
  input logic                                    refused_o,
  input logic                                    ray_valid_o,
  input logic                                    ray_ready_i,
  input logic signed [lipp_optics_pkg::PixelBits-1:0] ray_u_o,
  input logic signed [lipp_optics_pkg::PixelBits-1:0] ray_v_o,
  input logic signed [F+1:0]                     ray_a_o,
  input logic signed [F+1:0]                     ray_b_o,
  input logic                                    ray_first_o,
  input logic                                    ray_last_o
);

  localparam int Bits = 2 * lipp_optics_pkg::PixelBits + 2 * (F + 2) + 2;

  reg reset_q = 0;  // 1: a first reset has begun; before it, nothing is checked
  always @(posedge clk_i or negedge rst_ni) if (!rst_ni) reset_q <= 1;
  wire checked = rst_ni && reset_q;

  wire accept = ray_valid_o && ray_ready_i;
  wire [Bits-1:0] ray = {ray_u_o, ray_v_o, ray_a_o, ray_b_o, ray_first_o, ray_last_o};
  reg stalled_q, within_q;
  reg [Bits-1:0] ray_q;
  always @(posedge clk_i or negedge rst_ni) begin
    if (!rst_ni) begin
      stalled_q <= 0;
      within_q <= 0;
    end else begin
      stalled_q <= ray_valid_o && !ray_ready_i && !abort_i;
      if (abort_i) within_q <= 0;
      else if (accept) within_q <= !ray_last_o;
    end
  end
  always @(posedge clk_i) ray_q <= ray;

  always @(posedge clk_i) begin
    if (checked) begin
      stable: assert(!stalled_q || (ray_valid_o && ray == ray_q));
      first: assert(!ray_valid_o || ray_first_o == !within_q);
      runs: assert((!ray_valid_o && !within_q) || running_o);
      refused: assert(!refused_o || !running_o);
    end
  end

endmodule

`ifndef FORMAL  // in simulation, bind the checks to every instance
bind lipp_raster lipp_raster_checks #(.F(F)) i_checks (.*);
`endif
