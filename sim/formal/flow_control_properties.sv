/// `flow_control` around a pipeline of any function: a ray carries its index instead of data.
///
/// The n-th accepted ray enters with the index n, leaves the pipeline Latency clocks later, and
/// must be the n-th to leave. A stage without a ray carries arbitrary data (junk_i). Indices count
/// modulo 2^(AddressBits+1), twice the number of rays that can be inside.
module flow_control_properties #(
  parameter int Latency = 4,
  parameter int AddressBits = 4,             // 4: the FIFO's words below are written out
  parameter int Index = AddressBits + 1,
  parameter bit Guide = 1'b0  // covers: a ray is always offered, none is taken until full
) (
  input  logic             clk_i,
  input  logic             rst_ni,
  input  logic             hold_i,
  input  logic             valid_i,
  input  logic             ready_i,
  input  logic [Index-1:0] junk_i,
  output logic             idle_o,
  output logic             accept_o,
  output logic             watched_enters_o,  // the watched ray is accepted
  output logic             watched_inside_o   // it is inside
);

  localparam int Room = 1 << AddressBits;
  // Clocks with a ready reader after which the input is open again, from any state.
  localparam int Reopens = 4;

  // Internal registers: flattening connects these wires to those of the same name.
  (* hierconn *) wire [AddressBits:0] \i_flow.taken_q ;
  (* hierconn *) wire \i_flow.open_q ;
  (* hierconn *) wire [Latency-1:0] \i_flow.gen_marks[0].valid_q ;
  (* hierconn *) wire [AddressBits-1:0] \i_flow.i_fifo.write_at_q ;
  (* hierconn *) wire [AddressBits-1:0] \i_flow.i_fifo.read_at_q ;
  (* hierconn *) wire [AddressBits:0] \i_flow.i_fifo.stored_q ;
  (* hierconn *) wire [1:0] \i_flow.i_fifo.asked_q ;
  (* hierconn *) wire [2:0] \i_flow.i_fifo.held_q ;
  (* hierconn *) wire \i_flow.i_fifo.some_q ;
  (* hierconn *) wire \i_flow.i_fifo.free_q ;
  (* hierconn *) wire [1:0] \i_flow.i_fifo.put_q ;
  (* hierconn *) wire [1:0] \i_flow.i_fifo.get_q ;
  (* hierconn *) wire [2:0] \i_flow.i_fifo.ready_words_q ;
  (* hierconn *) wire [Index-1:0] \i_flow.i_fifo.place_q[0] ;
  (* hierconn *) wire [Index-1:0] \i_flow.i_fifo.place_q[1] ;
  (* hierconn *) wire [Index-1:0] \i_flow.i_fifo.place_q[2] ;
  (* hierconn *) wire [Index-1:0] \i_flow.i_fifo.place_q[3] ;
  (* hierconn *) wire [Index-1:0] \i_flow.i_fifo.read_data ;
  (* hierconn *) wire [Index-1:0] \i_flow.i_fifo.i_memory.word_q ;
  (* hierconn *) wire [Index-1:0] \i_flow.i_fifo.i_memory.words[0] ;
  (* hierconn *) wire [Index-1:0] \i_flow.i_fifo.i_memory.words[1] ;
  (* hierconn *) wire [Index-1:0] \i_flow.i_fifo.i_memory.words[2] ;
  (* hierconn *) wire [Index-1:0] \i_flow.i_fifo.i_memory.words[3] ;
  (* hierconn *) wire [Index-1:0] \i_flow.i_fifo.i_memory.words[4] ;
  (* hierconn *) wire [Index-1:0] \i_flow.i_fifo.i_memory.words[5] ;
  (* hierconn *) wire [Index-1:0] \i_flow.i_fifo.i_memory.words[6] ;
  (* hierconn *) wire [Index-1:0] \i_flow.i_fifo.i_memory.words[7] ;
  (* hierconn *) wire [Index-1:0] \i_flow.i_fifo.i_memory.words[8] ;
  (* hierconn *) wire [Index-1:0] \i_flow.i_fifo.i_memory.words[9] ;
  (* hierconn *) wire [Index-1:0] \i_flow.i_fifo.i_memory.words[10] ;
  (* hierconn *) wire [Index-1:0] \i_flow.i_fifo.i_memory.words[11] ;
  (* hierconn *) wire [Index-1:0] \i_flow.i_fifo.i_memory.words[12] ;
  (* hierconn *) wire [Index-1:0] \i_flow.i_fifo.i_memory.words[13] ;
  (* hierconn *) wire [Index-1:0] \i_flow.i_fifo.i_memory.words[14] ;
  (* hierconn *) wire [Index-1:0] \i_flow.i_fifo.i_memory.words[15] ;
  wire [AddressBits:0] taken = \i_flow.taken_q ;
  wire [Latency-1:0] marks = \i_flow.gen_marks[0].valid_q ;

  reg started_q = 0;
  always @(posedge clk_i) started_q <= 1;
  always @* if (!started_q) assume(!rst_ni);

  // ---- the rays' indices, and the pipeline that carries them ----
  logic ready, valid;
  logic [Index-1:0] index;
  wire accept = valid_i && ready;
  wire leave = valid && ready_i;
  reg [Index-1:0] accepted_q, left_q;
  always @(posedge clk_i or negedge rst_ni) begin
    if (!rst_ni) begin
      accepted_q <= 0;
      left_q <= 0;
    end else begin
      accepted_q <= accepted_q + accept;
      left_q <= left_q + leave;
    end
  end
  reg [Latency*Index-1:0] pipeline_q;
  wire [(Latency+1)*Index-1:0] pipeline = {pipeline_q, accept ? accepted_q : junk_i};
  always @(posedge clk_i) pipeline_q <= pipeline[Latency*Index-1:0];

  flow_control #(.Latency(Latency), .AddressBits(AddressBits), .Width(Index)) i_flow (
    .clk_i, .rst_ni, .hold_i, .idle_o, .valid_i, .ready_o(ready),
    .piped_i(pipeline_q[(Latency-1)*Index +: Index]),
    .valid_o(valid), .ready_i, .data_o(index)
  );

  // ---- the watched ray: any index ----
  (* anyconst *) reg [Index-1:0] watch;
  wire [Index-1:0] before = watch - left_q;  // rays that leave before it
  assign accept_o = accept;
  assign watched_enters_o = accept && accepted_q == watch;
  assign watched_inside_o = before < taken;

  logic [AddressBits:0] waiting, ahead;
  logic watching;
  logic [2:0] waits;
  logic [Index-1:0] watched;
  wire last = marks[Latency-1];
  wire [Index-1:0] piped = pipeline_q[(Latency-1)*Index +: Index];
  fifo_properties #(.Width(Index), .AddressBits(AddressBits), .Assume(1'b0)) i_fifo_properties (
    .clk_i, .rst_ni, .write_i(last), .data_i(piped),
    .valid_i(valid), .ready_i, .out_i(index), .watch_i(piped == watch),
    .write_at_i(\i_flow.i_fifo.write_at_q ), .read_at_i(\i_flow.i_fifo.read_at_q ),
    .stored_i(\i_flow.i_fifo.stored_q ), .asked_i(\i_flow.i_fifo.asked_q ),
    .held_i(\i_flow.i_fifo.held_q ), .some_i(\i_flow.i_fifo.some_q ),
    .free_i(\i_flow.i_fifo.free_q ), .put_i(\i_flow.i_fifo.put_q ),
    .get_i(\i_flow.i_fifo.get_q ), .ready_words_i(\i_flow.i_fifo.ready_words_q ),
    .place_i({\i_flow.i_fifo.place_q[3] , \i_flow.i_fifo.place_q[2] ,
      \i_flow.i_fifo.place_q[1] , \i_flow.i_fifo.place_q[0] }),
    .word_i(\i_flow.i_fifo.i_memory.word_q ),
    .read_data_i(\i_flow.i_fifo.read_data ),
    .words_i({
      \i_flow.i_fifo.i_memory.words[15] , \i_flow.i_fifo.i_memory.words[14] ,
      \i_flow.i_fifo.i_memory.words[13] , \i_flow.i_fifo.i_memory.words[12] ,
      \i_flow.i_fifo.i_memory.words[11] , \i_flow.i_fifo.i_memory.words[10] ,
      \i_flow.i_fifo.i_memory.words[9] , \i_flow.i_fifo.i_memory.words[8] ,
      \i_flow.i_fifo.i_memory.words[7] , \i_flow.i_fifo.i_memory.words[6] ,
      \i_flow.i_fifo.i_memory.words[5] , \i_flow.i_fifo.i_memory.words[4] ,
      \i_flow.i_fifo.i_memory.words[3] , \i_flow.i_fifo.i_memory.words[2] ,
      \i_flow.i_fifo.i_memory.words[1] , \i_flow.i_fifo.i_memory.words[0]
    }),
    .count_o(waiting), .watching_o(watching), .ahead_o(ahead), .watched_o(watched),
    .waits_o(waits)
  );

  // ---- rays in the pipeline: young[s] in the stages up to s ----
  wire [Latency*Index-1:0] young;
  wire [Latency-1:0] stage_right;  // the ray in this stage has the right index
  for (genvar s = 0; s < Latency; s = s + 1) begin : gen_stage
    if (s == 0) assign young[0 +: Index] = marks[0];
    else assign young[s*Index +: Index] = young[(s-1)*Index +: Index] + marks[s];
    wire [Index-1:0] after = pipeline_q[s*Index +: Index] + young[s*Index +: Index];
    assign stage_right[s] = !marks[s] || after == accepted_q;
  end
  wire [Index-1:0] inside = young[(Latency-1)*Index +: Index];

  // ---- durations ----
  reg [2:0] flows_q;        // clocks with the reader ready and no hold
  reg [Latency+3:0] entered_q;  // the clocks in which a ray was accepted
  always @(posedge clk_i or negedge rst_ni) begin
    if (!rst_ni) begin
      flows_q <= 0;
      entered_q <= 0;
    end else begin
      if (!ready_i || hold_i) flows_q <= 0;
      else if (flows_q < Reopens) flows_q <= flows_q + 1;
      entered_q <= {entered_q[Latency+2:0], accept};
    end
  end

  // ---- the contract ----
  always @(posedge clk_i) begin
    if (rst_ni) begin
      // Nothing lost, duplicated or reordered: the n-th to leave is the n-th accepted.
      in_order: assert(!valid || left_q != watch || index == watch);
      out_of_nothing: assert(!valid || left_q != accepted_q);
      room: assert(taken <= Room && (!ready || taken < Room));
      hold: assert(!hold_i || !ready);
      idle: assert(idle_o == (accepted_q == left_q));
      idle_empty: assert(!idle_o || (marks == 0 && !valid && waiting == 0));
      // A reader that is always ready keeps the input open. Latency + 4 clocks after a ray was
      // accepted it gets that ray, or an earlier one that had to wait.
      open: assert(flows_q < Reopens || hold_i || ready);
      no_bubble: assert(!entered_q[Latency+3] || valid);
    end
  end

  // ---- invariants ----
  always @(posedge clk_i) begin
    if (rst_ni) begin
      inside_taken: assert(accepted_q == left_q + taken);
      inside_places: assert(taken == waiting + inside);
      inside_open: assert(!\i_flow.open_q || taken < Room);
      inside_pipeline: assert(&stage_right);
      inside_entered: assert(entered_q[Latency-1:0] == marks
          && (!entered_q[Latency] || \i_flow.i_fifo.stored_q != 0)
          && (entered_q[Latency+1 +: 3] & ~waits) == 0);
      inside_flows: assert(flows_q <= Reopens && (flows_q < 1 || taken < Room)
          && (flows_q < 2 || taken < Room - 1 || !\i_flow.open_q )
          && (flows_q < 3 || taken < Room - 1));
      inside_watching: assert(watching == (before < waiting));
      inside_watched: assert(!watching || (ahead == before && watched == watch));
    end
  end

  // ---- covers ----
  reg was_full_q;
  always @(posedge clk_i or negedge rst_ni) begin
    if (!rst_ni) was_full_q <= 0;
    else was_full_q <= was_full_q || waiting == Room;
  end
  if (Guide) begin : gen_guide
    always @* assume(rst_ni == started_q && valid_i
        && ready_i == was_full_q && hold_i == was_full_q);
    always @(posedge clk_i) begin
      if (rst_ni) begin
        cover_full: cover(taken == Room && waiting == Room);
        cover_drained: cover(was_full_q && idle_o);
      end
    end
  end else begin : gen_free
    always @(posedge clk_i) begin
      if (rst_ni) begin
        cover_stream: cover(entered_q == {(Latency+4){1'b1}} && leave && accept);
        cover_watched: cover(leave && left_q == watch && watch == 2);
        cover_held: cover(hold_i && idle_o && left_q != 0);
      end
    end
  end

endmodule
