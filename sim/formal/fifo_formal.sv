/// `fifo` with a writer that never overfills it, and any reader.
module fifo_formal #(
  parameter int Width = 2,
  parameter int AddressBits = 2  // 2 or 3
) (
  input logic             clk_i,
  input logic             rst_ni,
  input logic             write_i,
  input logic [Width-1:0] data_i,
  input logic             ready_i,
  input logic             watch_i
);

  // Internal registers: flattening connects these wires to those of the same name.
  (* hierconn *) wire [AddressBits-1:0] \i_fifo.write_at_q ;
  (* hierconn *) wire [AddressBits-1:0] \i_fifo.read_at_q ;
  (* hierconn *) wire [AddressBits:0] \i_fifo.stored_q ;
  (* hierconn *) wire [1:0] \i_fifo.asked_q ;
  (* hierconn *) wire [2:0] \i_fifo.held_q ;
  (* hierconn *) wire \i_fifo.some_q ;
  (* hierconn *) wire \i_fifo.free_q ;
  (* hierconn *) wire [1:0] \i_fifo.put_q ;
  (* hierconn *) wire [1:0] \i_fifo.get_q ;
  (* hierconn *) wire [2:0] \i_fifo.ready_words_q ;
  (* hierconn *) wire [Width-1:0] \i_fifo.place_q[0] ;
  (* hierconn *) wire [Width-1:0] \i_fifo.place_q[1] ;
  (* hierconn *) wire [Width-1:0] \i_fifo.place_q[2] ;
  (* hierconn *) wire [Width-1:0] \i_fifo.place_q[3] ;
  (* hierconn *) wire [Width-1:0] \i_fifo.i_memory.word_q ;
  (* hierconn *) wire [Width-1:0] \i_fifo.read_data ;
  (* hierconn *) wire [Width-1:0] \i_fifo.i_memory.words[0] ;
  (* hierconn *) wire [Width-1:0] \i_fifo.i_memory.words[1] ;
  (* hierconn *) wire [Width-1:0] \i_fifo.i_memory.words[2] ;
  (* hierconn *) wire [Width-1:0] \i_fifo.i_memory.words[3] ;
  (* hierconn *) wire [Width-1:0] \i_fifo.i_memory.words[4] ;
  (* hierconn *) wire [Width-1:0] \i_fifo.i_memory.words[5] ;
  (* hierconn *) wire [Width-1:0] \i_fifo.i_memory.words[6] ;
  (* hierconn *) wire [Width-1:0] \i_fifo.i_memory.words[7] ;

  logic valid;
  logic [Width-1:0] data;
  fifo #(.Width(Width), .AddressBits(AddressBits)) i_fifo (
    .clk_i, .rst_ni, .write_i, .data_i, .valid_o(valid), .ready_i, .data_o(data)
  );

  reg started_q = 0;
  always @(posedge clk_i) started_q <= 1;
  always @* if (!started_q) assume(!rst_ni);

  fifo_properties #(.Width(Width), .AddressBits(AddressBits), .Assume(1'b1)) i_properties (
    .clk_i, .rst_ni, .write_i, .data_i, .valid_i(valid), .ready_i, .out_i(data), .watch_i,
    .write_at_i(\i_fifo.write_at_q ), .read_at_i(\i_fifo.read_at_q ),
    .stored_i(\i_fifo.stored_q ), .asked_i(\i_fifo.asked_q ), .held_i(\i_fifo.held_q ),
    .some_i(\i_fifo.some_q ), .free_i(\i_fifo.free_q ),
    .put_i(\i_fifo.put_q ), .get_i(\i_fifo.get_q ), .ready_words_i(\i_fifo.ready_words_q ),
    .place_i({\i_fifo.place_q[3] , \i_fifo.place_q[2] ,
      \i_fifo.place_q[1] , \i_fifo.place_q[0] }), .word_i(\i_fifo.i_memory.word_q ),
    .read_data_i(\i_fifo.read_data ),
    .words_i({
      \i_fifo.i_memory.words[7] , \i_fifo.i_memory.words[6] ,
      \i_fifo.i_memory.words[5] , \i_fifo.i_memory.words[4] ,
      \i_fifo.i_memory.words[3] , \i_fifo.i_memory.words[2] ,
      \i_fifo.i_memory.words[1] , \i_fifo.i_memory.words[0] }),
    .count_o(), .watching_o(), .ahead_o(), .watched_o(), .waits_o()
  );

endmodule
