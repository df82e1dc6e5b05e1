// A memory of 128 words behind APB4. Each access takes clocks_i clocks, or 1 to 4, now and then up to
// 19. Addresses 0x140 to 0x17f answer with an error. What is not said is noise.
module apb_memory (
  input  logic        clk_i,
  input  logic        rst_ni,
  input  logic [4:0]  clocks_i,  // of the access phase; 0: random
  input  logic        psel,
  input  logic        penable,
  input  logic        pwrite,
  input  logic [2:0]  pprot,
  input  logic [8:0]  paddr,
  input  logic [31:0] pwdata,
  input  logic [3:0]  pstrb,
  output logic        pready,
  output logic [31:0] prdata,
  output logic        pslverr
);
  logic [31:0] words[128];
  logic [31:0] noise_q;
  logic [4:0] remaining_q;
  wire wrong = paddr[8:6] == 3'd5;
  always_ff @(posedge clk_i or negedge rst_ni) begin
    if (!rst_ni) begin
      noise_q <= 32'h1908_1908;
      remaining_q <= '0;
    end else begin
      noise_q <= noise_q << 1 ^ (noise_q[31] ? 32'h0040_0007 : 32'h0);
      if (psel && !penable) begin
        remaining_q <= clocks_i != '0 ? clocks_i - 1'b1 :
            noise_q[7:3] == '0 ? 5'(noise_q[11:8]) + 5'd3 : 5'(noise_q[9:8]);
      end else if (remaining_q != '0) begin
        remaining_q <= remaining_q - 1'b1;
      end
    end
  end
  assign pready = psel && penable ? remaining_q == '0 : noise_q[20];
  assign pslverr = psel && penable && pready ? wrong : noise_q[21];
  assign prdata = psel && penable && pready && !pwrite && !wrong ? words[paddr[8:2]] : ~noise_q;
  always_ff @(posedge clk_i) if (psel && penable && pready) begin
    for (int k = 0; k < 4; k++) begin
      if (pwrite && !wrong && pstrb[k]) words[paddr[8:2]][8*k+:8] <= pwdata[8*k+:8];
    end
  end
endmodule
