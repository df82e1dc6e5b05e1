/// `ray_lenslet` as a whole: `config_bank` makes a copy only while `flow_control` is idle.
///
/// The pipeline is any function of configuration and ray with a fixed latency. The properties say
/// that the configuration does not change while a ray is in the pipeline.
module ray_lenslet_properties #(
  parameter int Latency = 3,
  parameter int Width = 2   // of the configuration
) (
  input logic             clk_i,
  input logic             rst_ni,
  input logic [Width-1:0] config_i,
  input logic             apply_i,
  input logic             valid_i,
  input logic             ready_i,
  input logic [4:0]       junk_i
);

  logic busy, idle, accept, enters, inside;
  logic [Width-1:0] used;
  config_bank #(.Width(Width)) i_config_bank (
    .clk_i, .rst_ni, .config_i, .apply_i, .idle_i(idle), .busy_o(busy), .config_o(used)
  );
  flow_control_properties #(.Latency(Latency)) i_flow_control (
    .clk_i, .rst_ni, .hold_i(busy), .valid_i, .ready_i, .junk_i,
    .idle_o(idle), .accept_o(accept), .watched_enters_o(enters), .watched_inside_o(inside)
  );

  (* hierconn *) wire \i_config_bank.copy_q ;

  // ---- the configuration as each ray sees it ----
  reg [Width-1:0] entered_with_q, used_q;
  reg known_q, idle_q;  // known_q: used_q and idle_q are valid, no reset since
  always @(posedge clk_i) begin
    if (enters) entered_with_q <= used;
    used_q <= used;
    idle_q <= idle;
  end
  always @(posedge clk_i or negedge rst_ni) begin
    if (!rst_ni) known_q <= 0;
    else known_q <= 1;
  end

  // ---- a configuration that is applied and then not changed ----
  (* anyconst *) reg [Width-1:0] wanted;
  reg steady_q;   // applied in an earlier clock (or by reset), unchanged since
  always @(posedge clk_i or negedge rst_ni) begin
    if (!rst_ni) steady_q <= 1;
    else steady_q <= config_i == wanted && (steady_q || apply_i);
  end

  always @(posedge clk_i) begin
    if (rst_ni) begin
      copy_idle: assert(!\i_config_bank.copy_q || (busy && idle));
      only_idle: assert(!known_q || used == used_q || idle_q);
      one_configuration: assert(!inside || used == entered_with_q);
      closed: assert(!busy || !accept);
      taken_over: assert(!steady_q || !accept || used == wanted);
      inside_steady: assert(!steady_q || busy || used == wanted);
    end
  end

  // ---- covers ----
  reg [1:0] changed_q;  // changes between rays
  reg waited_q;         // a copy had to wait for rays on the way
  always @(posedge clk_i or negedge rst_ni) begin
    if (!rst_ni) begin
      changed_q <= 0;
      waited_q <= 0;
    end else begin
      if (known_q && used != used_q && changed_q != 3) changed_q <= changed_q + 1;
      waited_q <= waited_q || (busy && !idle && inside);
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
