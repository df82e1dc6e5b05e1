// Feeds a file to cobs_decoder and packet_fifo, and writes what comes out of them, pauses at both ends.
module fuzz_bench(
  input  logic clk_i,
  input  logic rst_ni,
  output logic done_o
);
  int wire_file, out_file, fates_file, next, hold, quiet;
  string name;
  logic over;
  initial begin
    void'($value$plusargs("wire=%s", name));
    wire_file = $fopen(name, "rb");
    void'($value$plusargs("out=%s", name));
    out_file = $fopen(name, "w");
    void'($value$plusargs("fates=%s", name));
    fates_file = $fopen(name, "w");
  end

  logic in_valid, in_ready, valid, ready, out_valid, out_ready, out_last, ended, bad;
  logic [7:0] in_data, data, out_data;
  logic accepted, dropped_long, dropped_cobs, dropped_short, dropped_crc;
  lipp_cobs_decoder i_decoder (
    .clk_i, .rst_ni, .in_valid_i(in_valid), .in_ready_o(in_ready), .in_data_i(in_data),
    .out_valid_o(valid), .out_ready_i(ready), .out_data_o(data), .out_end_o(ended), .out_bad_o(bad)
  );
  lipp_packet_fifo #(.AddressBits(12)) i_fifo (
    .clk_i, .rst_ni, .in_valid_i(valid), .in_ready_o(ready), .in_data_i(data), .in_end_i(ended),
    .in_bad_i(bad), .out_valid_o(out_valid), .out_ready_i(out_ready), .out_data_o(out_data),
    .out_last_o(out_last), .accepted_o(accepted), .dropped_long_o(dropped_long),
    .dropped_cobs_o(dropped_cobs), .dropped_short_o(dropped_short), .dropped_crc_o(dropped_crc)
  );

  always_ff @(posedge clk_i or negedge rst_ni) begin
    if (!rst_ni) begin
      {in_valid, out_ready, over, done_o} <= '0;
      hold <= 0;
      quiet <= 0;
    end else if ($time != 0) begin  // not an edge that the random values before reset make
      if (!in_valid || in_ready) begin
        in_valid <= 1'b0;
        if (!over && $urandom % 8 != 0) begin
          next = $fgetc(wire_file);
          if (next < 0) over <= 1'b1;
          else {in_valid, in_data} <= {1'b1, next[7:0]};
        end
      end
      // Taken with short pauses, and now and then not at all until the memory is full.
      hold <= hold > 0 ? hold - 1 : ($urandom % 40000 == 0 ? 6000 : 0);
      out_ready <= hold == 0 && $urandom % 8 != 0;
      if (out_valid && out_ready) begin
        $fwrite(out_file, "%02x", out_data);
        if (out_last) $fwrite(out_file, "\n");
      end
      if (accepted) $fwrite(fates_file, "a");
      if (dropped_long) $fwrite(fates_file, "l");
      if (dropped_cobs) $fwrite(fates_file, "c");
      if (dropped_short) $fwrite(fates_file, "s");
      if (dropped_crc) $fwrite(fates_file, "r");
      quiet <= over && !in_valid && !out_valid ? quiet + 1 : 0;
      done_o <= quiet > 100;
    end
  end
  always_ff @(posedge done_o) begin
    $fclose(out_file);
    $fclose(fates_file);
  end
endmodule
