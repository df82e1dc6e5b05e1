// SPDX-License-Identifier: Apache-2.0
`default_nettype none

/// Executes the requests that use the optics block; only one request at a time uses the pipeline.
///
/// Input start_i starts the operation op_i, which must be stable until done_o. Output done_o is a
/// pulse, and status_o is valid in the same clock. While the optics draw the panel (drawn_i high),
/// OpClaim, OpTrace and OpSign return StatusBusy without effect. OpDraw and OpAbort return StatusOk
/// without effect.
///
/// While a frame of the raster runs or its rays are being signed, OpClaim, OpTrace, OpSign and
/// OpDraw return StatusBusy without effect. Together with StatusBusy, denied_o is high and runs_o
/// names the running task. OpTrace and OpSign wait until the pipeline is empty and their write to
/// `apply` has taken effect. Therefore a signature covers all rays of its own frame and no other
/// rays, and a trace returns only its own rays. Exit rays that no operation needs are dropped at
/// once, so the pipeline never stalls and every wait ends.
///
/// The bus_* ports connect to register_bus, one access at a time. The operations are:
///
///   OpClaim  waits until no apply is pending. StatusOk permits a write to the optics registers.
///   OpTrace  traces the rays of the stream. After done_o with StatusOk, nine words per exit ray
///            follow as a stream. Before the last ray's words, the raster is the source again.
///   OpSign   starts a frame whose rays are signed. OpSign returns StatusBusy if the frame has
///            started, otherwise StatusOptics.
///   OpResult returns StatusOk when all rays of the last OpSign are signed, otherwise StatusBusy or
///            StatusOptics.
///   OpAbort  aborts the running frame. OpAbort ends when no ray is left in the pipeline.
///   OpDraw   makes the stream the source, so that the panel can be drawn.
module lipp_ray_access (
  input  logic                         clk_i,
  input  logic                         rst_ni,
  input  logic                         clear_i,  // 1: the optics block is being reset
  input  logic                         drawn_i,  // 1: the optics draw the scene on the panel
  input  logic                         start_i,
  input  lipp_link_pkg::ray_op_e       op_i,
  input  logic [8:0]                   count_i,  // number of words of the rays to trace, 4 per ray
  output logic                         done_o,
  output lipp_link_pkg::reply_status_e status_o,
  output lipp_link_pkg::runs_e         runs_o,
  output logic                         denied_o,  // with done_o, 1: the pipeline was in use

  output logic [7:0]        word_at_o,     // index of the word to read among the rays' words
  input  logic [31:0]       word_i,        // word at index word_at_o, two clocks later
  output logic              word_valid_o,  // 1: word_o is a word of an exit ray
  input  logic              word_ready_i,
  output logic [31:0]       word_o,

  output logic              bus_start_o,
  output logic              bus_write_o,
  output logic [10:0]       bus_at_o,
  output logic [31:0]       bus_word_o,
  input  logic              bus_done_i,
  input  logic [31:0]       bus_word_i,

  output logic              ray_valid_o,
  input  logic              ray_ready_i,
  output logic [3:0][31:0]  ray_o,         // ray to trace; words u, v, a, b in [0] to [3]
  output logic              trace_o,       // 1: exit rays go to ray_access
  input  logic              exit_valid_i,
  output logic              exit_ready_o,
  input  logic [8:0][31:0]  exit_i,
  output logic              sign_o,        // 1: exit rays go to ray_signature
  output logic              sign_start_o,
  input  logic              sign_done_i
);
  import lipp_link_pkg::*;

  localparam logic [10:0] AtControl = 11'h20C, AtStatus = 11'h210, AtSource = 11'h214;
  localparam logic [31:0] Apply = 32'd1, Start = 32'd2, Abort = 32'd4;

  // The states from Claim to Ended access the register bus.
  typedef enum logic [3:0] {
    Claim, Source, TakeOver, TakenOver, Begin, Begun, End, Ended,
    Idle, Settle, Place, Placed, Fetch, Offer, Exit, Words
  } state_e;
  state_e state_q;
  logic bus_pending_q;  // 1: a register bus access is pending
  logic signing_q, sign_refused_q;
  logic restore_q;  // 1: the trace must end by making the raster the source
  logic [2:0] pause_q;
  logic [8:0] remaining_q;        // number of unread words of the rays to trace
  logic [7:0] at_q;
  logic [3:0] exit_left_q;
  logic [8:0][31:0] exit_q;

  // ---- access the optics block's registers over the bus ----
  logic on_bus, busy, running, refused, occupied, heard;
  assign on_bus = state_q inside {[Claim:Ended]};
  assign bus_start_o = on_bus && !bus_pending_q;
  assign bus_write_o = state_q inside {Source, TakeOver, Begin, End};
  assign heard = bus_pending_q && bus_done_i;
  assign {occupied, refused, running, busy} = bus_word_i[3:0];
  logic unused_word;
  assign unused_word = ^bus_word_i[31:4];
  always_comb begin
    {bus_at_o, bus_word_o} = {AtControl, Apply};
    case (state_q)
      Source: {bus_at_o, bus_word_o} = {AtSource, 32'(op_i == OpDraw
          || (op_i == OpTrace && !restore_q))};
      Begin: bus_word_o = Start;
      End: bus_word_o = Abort;
      Claim, TakenOver, Begun, Ended: bus_at_o = AtStatus;
      default: ;
    endcase
  end

  // ---- report the result of a signature ----
  reply_status_e result;
  assign sign_o = signing_q && !sign_done_i;
  assign result = sign_refused_q ? StatusOptics : sign_o ? StatusBusy : StatusOk;

  // ---- send rays to trace, and return exit rays as words ----
  assign word_at_o = at_q;
  assign ray_valid_o = state_q == Offer;
  assign exit_ready_o = state_q == Exit;
  // exit_q shifts one clock after its lowest word was taken. The delay of one clock shortens the
  // timing path, because exit_q is wide and its bits lie far apart on the FPGA.
  logic moves_q;
  assign word_valid_o = state_q == Words && !moves_q;
  assign word_o = exit_q[0];
  always_ff @(posedge clk_i) begin
    if (state_q == Fetch) ray_o <= {word_i, ray_o[3:1]};
    if (exit_valid_i && exit_ready_o) exit_q <= exit_i;
    else if (moves_q) exit_q <= {32'd0, exit_q[8:1]};
  end

  always_ff @(posedge clk_i or negedge rst_ni) begin
    if (!rst_ni) begin
      state_q <= Idle;
      status_o <= StatusOk;
      runs_o <= RunsNothing;
      {bus_pending_q, signing_q, sign_refused_q, restore_q, pause_q, remaining_q, at_q} <= '0;
      {exit_left_q, trace_o, sign_start_o, done_o, denied_o, moves_q} <= '0;
    end else if (clear_i) begin
      state_q <= Idle;
      {bus_pending_q, signing_q, sign_refused_q, restore_q, trace_o, sign_start_o, done_o} <= '0;
      moves_q <= 1'b0;
    end else begin
      {done_o, sign_start_o} <= '0;
      moves_q <= word_valid_o && word_ready_i;
      pause_q <= pause_q - 1'b1;
      if (on_bus) bus_pending_q <= !heard;
      case (state_q)
        Idle: if (start_i) begin
          {status_o, denied_o} <= {StatusOk, 1'b0};
          {remaining_q, at_q} <= {count_i, 8'd0};
          if (drawn_i && op_i != OpResult) begin
            done_o <= 1'b1;
            runs_o <= RunsScene;
            if (!(op_i inside {OpDraw, OpAbort})) {status_o, denied_o} <= {StatusBusy, 1'b1};
          end else case (op_i)
            OpAbort: state_q <= End;
            OpResult: begin
              {status_o, done_o} <= {result, 1'b1};
              runs_o <= RunsThis;
            end
            default: state_q <= Claim;
          endcase
        end
        // ---- states that check if the pipeline is free ----
        Claim: if (heard) begin
          if (running || sign_o) begin
            {status_o, done_o, denied_o} <= {StatusBusy, 2'b11};
            runs_o <= sign_o ? RunsSign : RunsFrame;
            state_q <= Idle;
          end else if (!busy) begin
            done_o <= op_i == OpClaim;
            state_q <= op_i == OpClaim ? Idle : Source;
          end
        end
        // ---- states that apply a source; the register bit busy falls after the apply ----
        Source: if (heard) state_q <= TakeOver;
        TakeOver: if (heard) state_q <= TakenOver;
        TakenOver: if (heard && !busy) begin
          restore_q <= 1'b0;
          trace_o <= op_i == OpTrace && !restore_q;
          done_o <= op_i == OpDraw || (op_i == OpTrace && !restore_q);
          sign_start_o <= op_i == OpSign;
          if (op_i == OpSign) signing_q <= 1'b1;
          state_q <= op_i == OpDraw ? Idle : op_i != OpTrace ? Begin : restore_q ? Words : Place;
        end
        // ---- states that start a frame ----
        Begin: if (heard) begin
          pause_q <= '1;
          state_q <= Settle;
        end
        Settle: if (pause_q == '0) state_q <= Begun;  // the raster checks its window
        Begun: if (heard) begin
          {signing_q, sign_refused_q} <= {!refused, refused};
          {status_o, done_o} <= {refused ? StatusOptics : StatusBusy, 1'b1};
          runs_o <= RunsThis;
          state_q <= Idle;
        end
        // ---- states that wait for the end of a frame ----
        End: if (heard) state_q <= Ended;
        Ended: if (heard && !(occupied || running || busy)) begin
          signing_q <= 1'b0;
          done_o <= 1'b1;
          state_q <= Idle;
        end
        // ---- states that trace the rays of a request one at a time ----
        Place: state_q <= Placed;
        Placed: state_q <= Fetch;
        Fetch: begin
          at_q <= at_q + 1'b1;
          remaining_q <= remaining_q - 1'b1;
          state_q <= at_q[1:0] == 2'd3 ? Offer : Place;
        end
        Offer: if (ray_ready_i) state_q <= Exit;
        Exit: if (exit_valid_i) begin
          exit_left_q <= 4'd9;
          trace_o <= remaining_q != '0;
          restore_q <= remaining_q == '0;
          state_q <= remaining_q != '0 ? Words : Source;
        end
        default: if (word_valid_o && word_ready_i) begin  // Words
          exit_left_q <= exit_left_q - 1'b1;
          if (exit_left_q == 4'd1) state_q <= remaining_q != '0 ? Place : Idle;
        end
      endcase
    end
  end

endmodule

`default_nettype wire
