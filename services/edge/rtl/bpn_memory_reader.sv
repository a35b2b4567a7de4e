// The host's view of the memories that conv1 and the engine read: a read waits for a clock that they leave free.
module bpn_memory_reader (
    input logic clk,

    input logic read,  // until `ready`
    input logic [3:0] region,  // 0 conv1's weights, 1 its thresholds, 2 the engine's weights, 3 conv1's map, 4 other maps
    input logic [4:0] lane,
    output logic ready,
    output logic [31:0] data,

    output logic hold_pixels,
    output logic read_conv1,  // the address counts in this clock
    output logic hold_engine,
    input logic engine_idle,
    output logic read_engine,

    // Four clocks after the first of two clocks with the address.
    input logic [32*bpn::CONV1_LANES-1:0] conv1_weights,
    input logic [31:0] conv1_threshold,
    input logic [255:0] engine_weights,
    input logic [15:0] conv1_map,
    input logic [15:0] maps
);
  logic pending, held;
  logic [2:0] waited;
  wire [4:0] conv1_lane = lane & 5'(bpn::CONV1_LANES - 1);

  assign read_conv1 = hold_pixels && held;
  assign read_engine = hold_engine && engine_idle;

  always_ff @(posedge clk) begin
    pending <= 1'b1;
    held <= hold_pixels;
    if (!pending) begin
      hold_pixels <= region == 4'd0;
      hold_engine <= region >= 4'd2;
    end
    if (waited != '0) waited <= waited + 1'b1;
    else if (read_conv1 || read_engine || (!pending && region == 4'd1)) waited <= 3'd1;
    if (waited == 3'd1) {hold_pixels, hold_engine} <= '0;
    ready <= waited == 3'd4;
    case (region)
      4'd0: data <= 32'(conv1_weights >> {conv1_lane, 5'd0});
      4'd1: data <= conv1_threshold;
      4'd2: data <= engine_weights[{lane[2:0], 5'd0}+:32];
      4'd3: data <= 32'(conv1_map);
      default: data <= 32'(maps);
    endcase
    if (!read || ready) {pending, waited, ready, held, hold_pixels, hold_engine} <= '0;
  end
endmodule
