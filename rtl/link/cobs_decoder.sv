`default_nettype none

/// Takes COBS frames, each with its 0x00 behind, apart: a beat for each byte of a packet, then one
/// without data.
///
/// Each byte in gives one beat or none, a clock later: a code stands for the zero in front of its
/// group, and 0x00 for the end. Frames without a byte give nothing.
module cobs_decoder (
  input  logic       clk_i,
  input  logic       rst_ni,
  input  logic       in_valid_i,
  output logic       in_ready_o,
  input  logic [7:0] in_data_i,
  output logic       out_valid_o,
  input  logic       out_ready_i,
  output logic [7:0] out_data_o,
  output logic       out_end_o,   // the packet is over; no data
  output logic       out_bad_o    // with end: its last group was cut short
);

  logic begun_q;       // a code was seen
  logic zero_q;        // a zero stands between this group and the next
  logic [7:0] left_q;  // bytes of the group still to come
  logic take, code, finish;
  assign in_ready_o = !out_valid_o || out_ready_i;
  assign take = in_valid_i && in_ready_o;
  assign finish = in_data_i == 8'h00;
  assign code = left_q == 8'd0;

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
      left_q <= '0;
    end else begin
      if (in_ready_o) out_valid_o <= take && begun_q && (finish || !code || zero_q);
      if (take) begin
        begun_q <= !finish;
        if (finish) begin
          left_q <= '0;
        end else if (code) begin
          left_q <= in_data_i - 8'd1;
          zero_q <= in_data_i != 8'hff;
        end else begin
          left_q <= left_q - 8'd1;
        end
      end
    end
  end

endmodule

`default_nettype wire
