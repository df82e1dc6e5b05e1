// SPDX-License-Identifier: Apache-2.0
`default_nettype none

/// Appends the CRC-32 to a packet, and encodes the result as a COBS frame with the final 0x00.
module lipp_packet_out (
  input  logic       clk_i,
  input  logic       rst_ni,
  input  logic       in_valid_i,
  output logic       in_ready_o,
  input  logic [7:0] in_data_i,
  input  logic       in_last_i,
  output logic       out_valid_o,
  input  logic       out_ready_i,
  output logic [7:0] out_data_o
);
  import lipp_link_pkg::*;

  logic [31:0] crc_q;
  logic [2:0] remaining_q;  // CRC bytes still to send; 0 during the packet
  logic body, valid, ready;
  assign body = remaining_q == 3'd0;
  assign valid = !body || in_valid_i;
  assign in_ready_o = body && ready;

  lipp_cobs_encoder i_encoder (
    .clk_i, .rst_ni,
    .in_valid_i(valid), .in_ready_o(ready), .in_data_i(body ? in_data_i : ~crc_q[7:0]),
    .in_last_i(remaining_q == 3'd1),
    .out_valid_o, .out_ready_i, .out_data_o
  );

  always_ff @(posedge clk_i or negedge rst_ni) begin
    if (!rst_ni) begin
      crc_q <= CrcStart;
      remaining_q <= '0;
    end else if (valid && ready) begin
      if (body) begin
        crc_q <= crc32_byte(crc_q, in_data_i);
        if (in_last_i) remaining_q <= 3'd4;
      end else begin
        // Ones are shifted into crc_q, so that crc_q is all ones, the initial state, after the last
        // byte.
        crc_q <= {8'hff, crc_q[31:8]};
        remaining_q <= remaining_q - 3'd1;
      end
    end
  end

endmodule

`default_nettype wire
