// SPDX-License-Identifier: Apache-2.0
`default_nettype none

/// After reset, writes the words of display_pkg::Writes over APB, one after the other.
module boot (
  input  logic        clk_i,
  input  logic        rst_ni,
  output logic        sel_o,
  output logic        enable_o,
  output logic [8:0]  addr_o,
  output logic [31:0] wdata_o,
  input  logic        ready_i
);
  import display_pkg::*;

  localparam int CountBits = $clog2(WriteCount + 1);
  logic [CountBits-1:0] count_q;
  assign sel_o = count_q != CountBits'(WriteCount);
  assign {addr_o, wdata_o} = sel_o ? Writes[count_q] : '0;

  always_ff @(posedge clk_i or negedge rst_ni) begin
    if (!rst_ni) begin
      count_q <= '0;
      enable_o <= 1'b0;
    end else if (enable_o && ready_i) begin
      count_q <= count_q + 1'b1;
      enable_o <= 1'b0;
    end else begin
      enable_o <= sel_o;
    end
  end

endmodule

`default_nettype wire
