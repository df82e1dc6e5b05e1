// SPDX-License-Identifier: Apache-2.0
`default_nettype none

/// Emits the centre of each pixel of the panel, row by row from the top left, once after reset.
///
/// u = 8 (2 column + 1 - Columns), v = 8 (Rows - 2 row - 1), in 1/16 pixel from the panel's centre.
module pixel_source
  import display_pkg::Columns, display_pkg::Rows, lipp_optics_pkg::PixelBits;
(
  input  logic                        clk_i,
  input  logic                        rst_ni,
  output logic                        valid_o,
  input  logic                        ready_i,
  output logic signed [PixelBits-1:0] u_o,
  output logic signed [PixelBits-1:0] v_o,
  output logic                        first_o,
  output logic                        last_o
);

  localparam logic signed [PixelBits-1:0] Left = PixelBits'(8 * (1 - Columns));
  localparam logic signed [PixelBits-1:0] Top = PixelBits'(8 * (Rows - 1));

  assign first_o = u_o == Left && v_o == Top;
  assign last_o = u_o == -Left && v_o == -Top;

  always_ff @(posedge clk_i or negedge rst_ni) begin
    if (!rst_ni) begin
      {valid_o, u_o, v_o} <= {1'b1, Left, Top};
    end else if (valid_o && ready_i) begin
      valid_o <= !last_o;
      u_o <= u_o == -Left ? Left : u_o + PixelBits'(16);
      if (u_o == -Left) v_o <= v_o - PixelBits'(16);
    end
  end

endmodule

`default_nettype wire
