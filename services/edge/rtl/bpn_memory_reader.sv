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

    // Three clocks after the address; thresholds at once.
    input logic [32*bpn::BYTES-1:0] conv1_weights,
    input logic [31:0] conv1_threshold,
    input logic [255:0] engine_weights,
    input logic [15:0] conv1_map,
    input logic [15:0] maps
);
  logic [1:0] waited;
  logic held;
  wire [4:0] conv1_lane = lane & 5'(bpn::BYTES - 1);
  wire asked = read && waited == '0 && !ready;

  assign hold_pixels = asked && region == 4'd0;
  assign hold_engine = asked && region >= 4'd2;
  assign read_conv1 = hold_pixels && held;
  assign read_engine = hold_engine && engine_idle;

  always_ff @(posedge clk) begin
    held <= hold_pixels;
    ready <= waited == 2'd3;
    waited <= waited == '0 ? 2'(read_conv1 || read_engine || (asked && region == 4'd1)) : waited + 1'b1;
    case (region)
      4'd0: data <= 32'(conv1_weights >> {conv1_lane, 5'd0});
      4'd1: data <= conv1_threshold;
      4'd2: data <= engine_weights[{lane[2:0], 5'd0}+:32];
      4'd3: data <= 32'(conv1_map);
      default: data <= 32'(maps);
    endcase
    if (!read) {waited, ready, held} <= '0;
  end
endmodule
