// SPDX-License-Identifier: Apache-2.0
`default_nettype none

/// Decodes COBS frames (packets encoded without zero bytes), each of which ends with a byte 0x00.
///
/// For each packet the output is one beat per byte, and then an end beat without data. Each input
/// byte produces at most one beat, one clock later. A code byte produces the zero byte before its
/// group, and 0x00 produces the end beat. An empty frame produces no beat.
module lipp_cobs_decoder (
  input  logic       clk_i,
  input  logic       rst_ni,
  input  logic       in_valid_i,
  output logic       in_ready_o,
  input  logic [7:0] in_data_i,
  output logic       out_valid_o,
  input  logic       out_ready_i,
  output logic [7:0] out_data_o,
  output logic       out_end_o,   // 1: end beat without data after a packet
  output logic       out_bad_o    // with out_end_o, 1: last group too short
);

  logic begun_q;       // 1: the first code byte of the frame has arrived
  logic zero_q;        // 1: a zero byte follows the current group
  logic [7:0] remaining_q;  // number of bytes of the group still to arrive
  logic take, code, finish;
  assign in_ready_o = !out_valid_o || out_ready_i;
  assign take = in_valid_i && in_ready_o;
  assign finish = in_data_i == 8'h00;
  assign code = remaining_q == 8'd0;

  always_ff @(posedge clk_i) begin
    if (take) begin
      out_data_o <= code ? 8'h00 : in_data_i;
      out_end_o <= finish;
      out_bad_o <= finish && !code;
    end
  end

  always_ff @(posedge clk_i or negedge rst_ni) begin
    if (!rst_ni) begin
      {out_valid_o, begun_q, zero_q} <= '0;
      remaining_q <= '0;
    end else begin
      if (in_ready_o) out_valid_o <= take && begun_q && (finish || !code || zero_q);
      if (take) begin
        begun_q <= !finish;
        if (finish) begin
          remaining_q <= '0;
        end else if (code) begin
          remaining_q <= in_data_i - 8'd1;
          zero_q <= in_data_i != 8'hff;
        end else begin
          remaining_q <= remaining_q - 8'd1;
        end
      end
    end
  end

endmodule

`default_nettype wire
