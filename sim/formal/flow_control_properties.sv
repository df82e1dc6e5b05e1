// SPDX-License-Identifier: Apache-2.0
/// Proves in two parts that `lipp_flow_control` is correct around a pipeline of Latency clocks.
///
/// The first proof (Order = 0) shows the assertions of flow_control_checks, which count rays. A
/// binary tree counts the rays in the pipeline, so that the induction is short at any Latency. Each
/// node contains the number of rays in its stages, and changes only with the rays that enter and
/// leave these stages. A node is the sum of its two children, and the root is the number of rays in
/// the pipeline.
///
/// The second proof (Order = 1) shows that the rays keep their order. The n-th accepted ray enters
/// with the index n, leaves the pipeline Latency clocks later, and must be the n-th ray to leave. A
/// stage without a ray contains arbitrary data (junk_i). Indices count modulo 2^(AddressBits+1),
/// twice the maximum number of rays inside. The second proof assumes a result of the first proof:
/// the FIFO is never overfilled.
module flow_control_properties #(
  parameter int Latency = 4,
  parameter int AddressBits = 4,
  parameter int Index = AddressBits + 1,
  parameter bit Order = 1'b0,    // 1: proof of the order of rays
  parameter bit AnyFifo = 1'b1,  // 1: FIFO model fifo_any; 0: `lipp_fifo`
  // 1, for cover statements: a ray is always offered, and no ray is taken until the FIFO is full.
  parameter bit Guide = 1'b0
) (
  input  logic             clk_i,
  input  logic             rst_ni,
  input  logic             hold_i,
  input  logic             valid_i,
  input  logic             ready_i,
  input  logic [Index-1:0] junk_i
);

  localparam int Room = 1 << AddressBits;
  // number of registers of valid bits, with 64 bits in each except the last
  localparam int Marks = (Latency + 63) / 64;
  localparam int LastMarks = Latency - 64 * (Marks - 1);

  // These wires carry internal registers of the design: yosys flattens the hierarchy and connects
  // each wire to the register of the same name. The wire of a register that does not exist at this
  // Latency has an arbitrary value, which the proof does not use.
  (* hierconn *) wire [AddressBits:0] \i_flow.reserved_q ;
  (* hierconn *) wire [1:0] \i_flow.departed_q ;
  (* hierconn *) wire [(Marks > 1 ? 64 : LastMarks)-1:0] \i_flow.gen_marks[0].valid_q ;
  (* hierconn *) wire [(Marks > 2 ? 64 : LastMarks)-1:0] \i_flow.gen_marks[1].valid_q ;
  (* hierconn *) wire [(Marks > 3 ? 64 : LastMarks)-1:0] \i_flow.gen_marks[2].valid_q ;
  (* hierconn *) wire [(Marks > 4 ? 64 : LastMarks)-1:0] \i_flow.gen_marks[3].valid_q ;
  (* hierconn *) wire [(Marks > 5 ? 64 : LastMarks)-1:0] \i_flow.gen_marks[4].valid_q ;
  (* hierconn *) wire [(Marks > 6 ? 64 : LastMarks)-1:0] \i_flow.gen_marks[5].valid_q ;
  (* hierconn *) wire [(Marks > 7 ? 64 : LastMarks)-1:0] \i_flow.gen_marks[6].valid_q ;
  (* hierconn *) wire [LastMarks-1:0] \i_flow.gen_marks[7].valid_q ;
  wire [AddressBits:0] reserved = \i_flow.reserved_q ;
  wire [Latency-1:0] marks;
  wire [AddressBits:0] counted = reserved + marks[0];  // includes a ray accepted in the last clock
  // number of rays that have left but are still counted
  wire [1:0] departed = \i_flow.departed_q [0] + \i_flow.departed_q [1];
  assign marks[(Marks > 1 ? 64 : Latency)-1:0] = \i_flow.gen_marks[0].valid_q ;
  if (Marks > 1) assign marks[(Marks > 2 ? 128 : Latency)-1:64] = \i_flow.gen_marks[1].valid_q ;
  if (Marks > 2) assign marks[(Marks > 3 ? 192 : Latency)-1:128] = \i_flow.gen_marks[2].valid_q ;
  if (Marks > 3) assign marks[(Marks > 4 ? 256 : Latency)-1:192] = \i_flow.gen_marks[3].valid_q ;
  if (Marks > 4) assign marks[(Marks > 5 ? 320 : Latency)-1:256] = \i_flow.gen_marks[4].valid_q ;
  if (Marks > 5) assign marks[(Marks > 6 ? 384 : Latency)-1:320] = \i_flow.gen_marks[5].valid_q ;
  if (Marks > 6) assign marks[(Marks > 7 ? 448 : Latency)-1:384] = \i_flow.gen_marks[6].valid_q ;
  if (Marks > 7) assign marks[Latency-1:448] = \i_flow.gen_marks[7].valid_q ;
  wire last = marks[Latency-1];
  (* hierconn *) wire \i_flow.i_fifo.write_i ;
  (* hierconn *) wire [Index-1:0] \i_flow.i_fifo.data_i ;
  (* hierconn *) wire \i_flow.i_fifo.valid_o ;
  (* hierconn *) wire \i_flow.i_fifo.ready_i ;
  (* hierconn *) wire [Index-1:0] \i_flow.i_fifo.data_o ;

  // These wires are the counters of flow_control_checks.
  (* hierconn *) wire [AddressBits:0] \gen_count.i_checks.inside_q ;
  (* hierconn *) wire [AddressBits:0] \gen_count.i_checks.recent_q ;
  (* hierconn *) wire [Latency+3:0] \gen_count.i_checks.entered_q ;
  (* hierconn *) wire [2:0] \gen_count.i_checks.flows_q ;
  (* hierconn *) wire [2:0] \gen_count.i_checks.leave_q ;
  wire [AddressBits:0] inside_q = \gen_count.i_checks.inside_q ;
  wire [AddressBits:0] recent = \gen_count.i_checks.recent_q ;
  wire [Latency+3:0] entered = \gen_count.i_checks.entered_q ;
  wire [2:0] flows = \gen_count.i_checks.flows_q ;

  reg started_q = 0;
  always @(posedge clk_i) started_q <= 1;
  // A later reset leads to the state of the first reset, so this proof also covers a later reset.
  always @* assume(rst_ni == started_q);

  // ---- give each ray an index, and model the pipeline that carries the indices ----
  logic ready, valid, idle;
  logic [Index-1:0] index;
  wire accept = valid_i && ready;
  wire leave = valid && ready_i;
  reg [Index-1:0] accepted_q, leaves_q;
  always @(posedge clk_i or negedge rst_ni) begin
    if (!rst_ni) begin
      accepted_q <= 0;
      leaves_q <= 0;
    end else begin
      accepted_q <= accepted_q + accept;
      leaves_q <= leaves_q + leave;
    end
  end
  // Stage s contains the number of rays accepted more than s + 1 clocks ago: its ray's index.
  reg [Latency*Index-1:0] before_q;
  always @(posedge clk_i or negedge rst_ni) begin
    if (!rst_ni) before_q <= 0;
    else before_q <= {before_q, accepted_q};
  end
  // index of the ray that leaves the pipeline
  wire [Index-1:0] written = before_q[(Latency-1)*Index +: Index];
  wire [Index-1:0] piped = last ? written : junk_i;

  lipp_flow_control #(.Latency(Latency), .AddressBits(AddressBits), .Width(Index)) i_flow (
    .clk_i, .rst_ni, .hold_i, .idle_o(idle), .valid_i, .ready_o(ready), .piped_i(piped),
    .valid_o(valid), .ready_i, .data_o(index)
  );

  // ---- model the FIFO; the solver chooses the watched ray ----
  (* anyconst *) reg [Index-1:0] watch;
  wire [AddressBits:0] waiting, ahead;
  wire [3:0] wrote;
  wire watching;
  wire [Index-1:0] watched;
  lipp_fifo_checks #(
    .Width(Index), .AddressBits(AddressBits), .AssumeWriter(Order), .AssumeFifo(AnyFifo)
  ) i_fifo_checks (
    .clk_i, .rst_ni, .write_i(\i_flow.i_fifo.write_i ), .data_i(\i_flow.i_fifo.data_i ),
    .valid_o(\i_flow.i_fifo.valid_o ), .ready_i(\i_flow.i_fifo.ready_i ),
    .data_o(\i_flow.i_fifo.data_o ), .watch_i(written == watch), .count_o(waiting),
    .wrote_o(wrote), .watching_o(watching), .ahead_o(ahead), .watched_o(watched)
  );

  if (Order) begin : gen_order
    wire [Index-1:0] before = watch - leaves_q;  // number of rays that leave before the watched ray
    wire [Latency-1:0] follows;  // bit s: the next count of stage s is its count plus marks[s]
    for (genvar s = 0; s < Latency; s = s + 1) begin : gen_stage
      wire [Index-1:0] entry = s == 0 ? accepted_q : before_q[(s == 0 ? 0 : s-1)*Index +: Index];
      assign follows[s] = entry == before_q[s*Index +: Index] + marks[s];
    end
    always @(posedge clk_i) begin
      if (rst_ni) begin
        // No ray is lost, duplicated or reordered: the n-th ray to leave is the n-th accepted ray.
        in_order: assert(!valid || leaves_q != watch || index == watch);
        inside_counted: assert(&follows);
        inside_waiting: assert(written == leaves_q + waiting);
        inside_watching: assert(watching == (before < waiting));
        inside_watched: assert(!watching || (ahead == before && watched == watch));
      end
    end
  end else begin : gen_count
    // ---- count the rays in the pipeline with a tree over its stages, numbered from the exit ----
    wire [Latency:0] from_exit;  // valid bits of the stages, and of an entering ray
    assign from_exit[Latency] = accept;
    for (genvar s = 0; s < Latency; s = s + 1) begin : gen_stage
      assign from_exit[s] = marks[Latency-1-s];
    end
    // Node n of level k has the index 2^k - 1 + n, as in a heap. The node covers Latency / 2^k
    // stages, rounded up to a power of two. Each leaf is one stage.
    localparam int Levels = $clog2(Latency);
    localparam int Leaves = 1 << Levels;
    wire [(2*Leaves-1)*Index-1:0] nodes;
    wire [Index-1:0] inside = nodes[0 +: Index];
    wire [2*Leaves-2:0] node_right;
    for (genvar k = 0; k <= Levels; k = k + 1) begin : gen_level
      localparam int Stages = Leaves >> k;
      for (genvar n = 0; n < (1 << k); n = n + 1) begin : gen_node
        localparam int At = (1 << k) - 1 + n;
        localparam int Exit = n * Stages;
        localparam int Entry = Exit + Stages < Latency ? Exit + Stages : Latency;
        if (Exit >= Latency || k == Levels) begin : gen_leaf
          assign nodes[At*Index +: Index] = Exit < Latency ? from_exit[Exit] : 1'b0;
          assign node_right[At] = 1'b1;
        end else begin : gen_sum
          reg [Index-1:0] count_q;
          always @(posedge clk_i or negedge rst_ni) begin
            if (!rst_ni) count_q <= 0;
            else count_q <= count_q + from_exit[Entry] - from_exit[Exit];
          end
          assign nodes[At*Index +: Index] = count_q;
          assign node_right[At] =
              count_q == nodes[(2*At+1)*Index +: Index] + nodes[(2*At+2)*Index +: Index];
        end
      end
    end

    lipp_flow_control_checks #(.Latency(Latency), .AddressBits(AddressBits),
        .Width(Index)) i_checks (
      .clk_i, .rst_ni, .hold_i, .idle_o(idle), .valid_i, .ready_o(ready), .valid_o(valid),
      .ready_i, .data_o(index)
    );
    always @(posedge clk_i) begin
      if (rst_ni) begin
        idle_empty: assert(!idle || (marks == 0 && !valid && waiting == 0));
        inside_taken: assert(counted == inside_q + departed);
        inside_left: assert(\i_flow.departed_q == \gen_count.i_checks.leave_q [1:0]);
        inside_written: assert(last == \i_flow.i_fifo.write_i );
        inside_tree: assert(&node_right);
        inside_places: assert(counted == waiting + inside + departed && counted <= Room);
        inside_recent: assert(recent == inside + wrote[0] + wrote[1] + wrote[2]);
        inside_open: assert(!ready || reserved <= Room - 2);
        inside_entered: assert(entered == {wrote, marks});
        inside_flows: assert(flows <= 6
            && (flows < 1 || inside_q < Room - 5 || \i_flow.departed_q [0])
            && (flows < 2 || inside_q < Room - 4 || \i_flow.departed_q [1])
            && (flows < 3 || (counted < Room && (!ready || reserved < Room - 2)))
            && (flows < 4 || counted < Room - 1) && (flows < 5 || reserved < Room - 2));
      end
    end
  end

  // ---- cover statements: events that the proof must reach ----
  reg was_full_q;
  always @(posedge clk_i or negedge rst_ni) begin
    if (!rst_ni) was_full_q <= 0;
    else was_full_q <= was_full_q || waiting == Room;
  end
  if (Guide) begin : gen_guide
    always @* assume(valid_i && ready_i == was_full_q && hold_i == was_full_q);
    always @(posedge clk_i) begin
      if (rst_ni) begin
        cover_full: cover(counted == Room && waiting == Room);
        cover_drained: cover(was_full_q && idle);
      end
    end
  end else begin : gen_free
    always @(posedge clk_i) begin
      if (rst_ni) begin
        cover_stream: cover(entered == {(Latency+4){1'b1}} && leave && accept);
        cover_watched: cover(leave && leaves_q == watch && watch == 2);
        cover_held: cover(hold_i && idle && leaves_q != 0);
      end
    end
  end

endmodule
