`default_nettype none

/// Makes a COBS frame of a packet, the 0x00 behind it included.
///
/// A group's code is its length, so a group goes out when all of it is in. Two banks, one filled
/// while the other is sent: a byte out each clock. The first is out 3 clocks after the group's end
/// came in.
module cobs_encoder (
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

  localparam logic [7:0] Longest = 8'd254;  // bytes of a group

  /// A bank holds a group's bytes at 1 to code - 1; of its places, 0 stands for the code, and the
  /// one behind the last byte, in a packet's last group, for the end.
  logic [7:0] bytes[512];
  logic [1:0] full_q;
  logic [1:0] final_q;
  logic [1:0][7:0] code_q;

  // ---- fill ----
  logic fill_q;       // the bank that is filled
  logic [7:0] put_q;  // where the next byte goes
  logic empty_q;      // the packet ended with a zero: an empty group ends it
  logic take, zero, close;
  assign in_ready_o = !full_q[fill_q] && !empty_q;
  assign take = in_valid_i && in_ready_o;
  assign zero = in_data_i == 8'h00;
  assign close = empty_q ? !full_q[fill_q] : take && (zero || in_last_i || put_q == Longest);

  always_ff @(posedge clk_i) begin
    if (take) bytes[{fill_q, put_q}] <= in_data_i;
    if (close) begin
      code_q[fill_q] <= zero || empty_q ? put_q : put_q + 8'd1;
      final_q[fill_q] <= empty_q || (in_last_i && !zero);
    end
  end

  // ---- send ----
  logic send_q;      // the bank that is sent
  logic [7:0] at_q;  // the place in it
  logic [7:0] code;
  logic some, done, step;
  assign code = code_q[send_q];
  assign some = full_q[send_q];
  assign done = at_q == (final_q[send_q] ? code : code - 8'd1);
  assign step = !out_valid_o || out_ready_i;

  logic late_valid_q, late_byte_q;
  logic [7:0] byte_q, other_q;
  always_ff @(posedge clk_i) begin
    if (step) begin
      byte_q <= bytes[{send_q, at_q}];
      late_byte_q <= at_q != 8'd0 && at_q != code;
      other_q <= at_q == 8'd0 ? code : 8'h00;
      out_data_o <= late_byte_q ? byte_q : other_q;
    end
  end

  always_ff @(posedge clk_i or negedge rst_ni) begin
    if (!rst_ni) begin
      full_q <= '0;
      {fill_q, empty_q, send_q, out_valid_o, late_valid_q} <= '0;
      put_q <= 8'd1;
      at_q <= '0;
    end else begin
      if (take) put_q <= put_q + 8'd1;
      if (close) begin
        full_q[fill_q] <= 1'b1;
        fill_q <= !fill_q;
        put_q <= 8'd1;
        empty_q <= !empty_q && in_last_i && zero;
      end
      if (step) begin
        {out_valid_o, late_valid_q} <= {late_valid_q, some};
        if (some) at_q <= at_q + 8'd1;
        if (some && done) begin
          full_q[send_q] <= 1'b0;
          send_q <= !send_q;
          at_q <= '0;
        end
      end
    end
  end

endmodule

`default_nettype wire
