// SPDX-License-Identifier: Apache-2.0
/// Proves that all rays inside `lipp_ray_stream` use the same optics: `lipp_config_bank` makes a
/// copy of the optics only while `lipp_flow_control` is idle.
///
/// A model replaces `lipp_flow_control` and the pipeline, at any latency. The model accepts no ray
/// after hold, contains rays that leave at any time, and raises idle at any time after the last ray
/// has left. `lipp_flow_control` is proved to behave like this model.
module ray_stream_properties #(
  parameter int Width = 2  // number of bits of the configuration
) (
  input logic             clk_i,
  input logic             rst_ni,
  input logic [Width-1:0] config_i,
  input logic             apply_i,
  input logic             valid_i,
  input logic             open_i,
  input logic             leave_i,
  input logic             late_i   // 1: delays the rise of idle after the last ray
);

  reg started_q = 0;
  always @(posedge clk_i) started_q <= 1;
  always @* if (!started_q) assume(!rst_ni);

  // ---- model of lipp_flow_control and the pipeline ----
  logic busy, hold;
  reg hold_q;
  always @(posedge clk_i or negedge rst_ni) begin
    if (!rst_ni) hold_q <= 1;
    else hold_q <= hold;
  end
  reg [9:0] inside_q;
  wire empty = inside_q == 0;
  wire idle = empty && !late_i;
  wire accept = valid_i && open_i && !hold_q && inside_q < 10'h3ff;
  wire leave = leave_i && !empty;
  always @(posedge clk_i or negedge rst_ni) begin
    if (!rst_ni) inside_q <= 0;
    else inside_q <= inside_q + accept - leave;
  end

  logic [Width-1:0] used;
  lipp_config_bank #(.Width(Width)) i_config_bank (
    .clk_i, .rst_ni, .config_i, .apply_i, .idle_i(idle), .busy_o(busy), .hold_o(hold),
    .config_o(used)
  );
  (* hierconn *) wire \i_config_bank.copy_q ;

  // ---- prove that the configuration does not change while rays are inside ----
  (* anyseq *) reg watch;
  reg [Width-1:0] entered_with_q, used_q;
  // past_valid_q: used_q and empty_q are values of the previous clock, without a reset since then
  reg watching_q, empty_q, past_valid_q;
  always @(posedge clk_i) begin
    if (accept && watch && !watching_q) entered_with_q <= used;
    used_q <= used;
    empty_q <= empty;
  end
  always @(posedge clk_i or negedge rst_ni) begin
    if (!rst_ni) begin
      watching_q <= 0;
      past_valid_q <= 0;
    end else begin
      // watching_q: the watched ray may be inside, at most until all rays have left.
      watching_q <= (watching_q && !(leave && inside_q == 1 && !accept)) || (accept && watch);
      past_valid_q <= 1;
    end
  end

  // ---- prove that rays use the applied configuration, if it is unchanged since the apply ----
  (* anyconst *) reg [Width-1:0] watched_config;
  reg steady_q;  // 1: applied earlier or by reset, and unchanged since then
  always @(posedge clk_i or negedge rst_ni) begin
    if (!rst_ni) steady_q <= 1;
    else steady_q <= config_i == watched_config && (steady_q || apply_i);
  end

  always @(posedge clk_i) begin
    if (rst_ni) begin
      copy_idle: assert(!\i_config_bank.copy_q || (busy && empty));
      only_idle: assert(!past_valid_q || used == used_q || empty_q);
      one_configuration: assert(!watching_q || (!empty && used == entered_with_q));
      held_busy: assert(hold_q == busy);
      closed: assert(!busy || !accept);
      taken_over: assert(!steady_q || !accept || used == watched_config);
      inside_steady: assert(!steady_q || busy || used == watched_config);
    end
  end

  // ---- cover statements: events that the proof must reach ----
  reg [1:0] changed_q;  // number of configuration changes between rays
  reg waited_q;         // 1: a copy waited for rays to leave the pipeline
  always @(posedge clk_i or negedge rst_ni) begin
    if (!rst_ni) begin
      changed_q <= 0;
      waited_q <= 0;
    end else begin
      if (past_valid_q && used != used_q && changed_q != 3) changed_q <= changed_q + 1;
      waited_q <= waited_q || (busy && !idle && watching_q);
    end
  end
  always @(posedge clk_i) begin
    if (rst_ni) begin
      cover_change: cover(waited_q && changed_q == 2 && accept);
      cover_taken_over: cover(waited_q && steady_q && accept);
      cover_apply_busy: cover(apply_i && busy && idle);
    end
  end

endmodule
