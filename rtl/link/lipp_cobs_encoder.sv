// SPDX-License-Identifier: Apache-2.0
`default_nettype none

/// Encodes a packet as a COBS frame (without zero bytes inside), including the final 0x00.
///
/// The code byte at the start of a group contains the group's length, so a group is sent only after
/// all its bytes have arrived. The encoder has two banks of memory: one bank is filled while the
/// other bank is sent. The throughput is one byte per clock if all groups have the same length, and
/// at least one byte per two clocks otherwise. The first byte of a group is sent 3 clocks after its
/// last byte arrived.
module lipp_cobs_encoder (
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

  localparam logic [7:0] Longest = 8'd254;  // maximum number of bytes in a group

  // Each of the two banks contains the bytes of a group from address 1 on. No address is written
  // and read in the same clock, so synthesis need not define this case.
  (* no_rw_check *) logic [7:0] bytes[512];
  logic [1:0] full_q;
  logic [1:0] final_q;       // bit k: bank k has the packet's last group
  logic [1:0][7:0] count_q;  // number of bytes in each bank

  // ---- fill a bank with the bytes of a group ----
  logic fill_q;          // index of the bank being filled
  logic [7:0] length_q;  // number of bytes in the bank being filled
  logic [7:0] next;
  logic empty_q;       // 1: packet ended with a zero; an empty group follows
  logic take, zero, close;
  assign in_ready_o = !full_q[fill_q] && !empty_q;
  assign take = in_valid_i && in_ready_o;
  assign zero = in_data_i == 8'h00;
  assign next = length_q + 8'd1;
  assign close = empty_q ? !full_q[fill_q] : take && (zero || in_last_i || next == Longest);

  always_ff @(posedge clk_i) begin
    if (take) bytes[{fill_q, next}] <= in_data_i;
    if (close) begin
      count_q[fill_q] <= zero || empty_q ? length_q : next;
      final_q[fill_q] <= empty_q || (in_last_i && !zero);
    end
  end

  // ---- send the code byte, the bytes of the bank, and 0x00 after the last group ----
  logic send_q;      // index of the bank being sent
  logic [7:0] at_q;  // address in the bank being sent; 0 is the code byte
  logic end_q;       // 1: only the final 0x00 is left to send
  logic [7:0] count;
  logic some, last, more, step;
  assign count = count_q[send_q];
  assign some = full_q[send_q];
  assign last = at_q == count;
  assign more = final_q[send_q] && !end_q;
  assign step = !out_valid_o || out_ready_i;

  logic late_valid_q, late_byte_q;
  logic [7:0] byte_q, other_q;
  always_ff @(posedge clk_i) begin
    if (step) begin
      byte_q <= bytes[{send_q, at_q}];
      late_byte_q <= at_q != 8'd0 && !end_q;
      other_q <= end_q ? 8'h00 : count + 8'd1;
      out_data_o <= late_byte_q ? byte_q : other_q;
    end
  end

  always_ff @(posedge clk_i or negedge rst_ni) begin
    if (!rst_ni) begin
      full_q <= '0;
      {fill_q, empty_q, send_q, end_q, out_valid_o, late_valid_q} <= '0;
      length_q <= '0;
      at_q <= '0;
    end else begin
      if (take) length_q <= next;
      if (close) begin
        full_q[fill_q] <= 1'b1;
        fill_q <= !fill_q;
        length_q <= '0;
        empty_q <= !empty_q && in_last_i && zero;
      end
      if (step) {out_valid_o, late_valid_q} <= {late_valid_q, some};
      if (step && some) begin
        if (!last) begin
          at_q <= at_q + 8'd1;
        end else if (more) begin
          end_q <= 1'b1;
        end else begin
          full_q[send_q] <= 1'b0;
          send_q <= !send_q;
          at_q <= '0;
          end_q <= 1'b0;
        end
      end
    end
  end

endmodule

`default_nettype wire
