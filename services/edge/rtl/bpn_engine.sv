// The layers after conv1: what is computed next, the memories that it is read from, the sums that come of it.
module bpn_engine (
    input logic clk,
    input logic rst_n,

    // The frame that it works at.
    input logic active,
    input logic frame,
    input logic bank,
    input logic [bpn::GROUP_W-1:0] node_groups,
    input logic [bpn::ACTION_GROUP_W-1:0] action_groups,
    input logic clear,
    input logic [7:0] conv1_words,
    output logic idle,

    // conv1's map, of two frames.
    input logic map_write,
    input logic map_half,
    input logic [7:0] map_address,
    input logic [15:0] map_word,

    // Weights, of two banks.
    input logic [7:0] weight_write,
    input logic write_bank,
    input logic [bpn::WEIGHT_W-1:0] write_address,
    input logic [31:0] write_data,

    // The host reads what lies in the memories while nothing is computed.
    input logic hold,
    input logic host_read,
    input logic host_bank,
    input logic host_frame,
    input logic [bpn::WEIGHT_W+2:0] host_address,
    output logic [255:0] weights,
    output logic [15:0] conv1_input,
    output logic [15:0] maps_input,

    // Sums of a group of outputs.
    output logic output_done,
    output logic [bpn::GROUP_W-1:0] done_group,
    output logic [16*bpn::ACC_W-1:0] sums
);
  logic step, is_bias, is_first, is_last;
  logic [1:0] layer;
  logic [7:0] input_address;
  logic [bpn::WEIGHT_W-1:0] weight_address;
  logic [bpn::GROUP_W-1:0] group;
  logic [6:0] conv2_words;
  logic [5:0] conv3_words;
  logic [bpn::GROUP_W-1:0] fc1_words;

  bpn_schedule u_schedule (
      .clk,
      .rst_n,
      .active,
      .node_groups,
      .action_groups,
      .clear,
      .conv1_words,
      .conv2_words,
      .conv3_words,
      .fc1_words,
      .hold,
      .idle,
      .step,
      .layer,
      .map_address(input_address),
      .weight_address,
      .group,
      .is_bias,
      .is_first,
      .is_last
  );

  // Engine maps lie in one memory: conv2's 81 words from 0, conv3's 49 from 128, FC(N)'s from 192.
  logic stepped, stepped_bias, stepped_first, stepped_last;
  logic [1:0] stepped_layer;
  logic [1:0] from_conv1;
  logic [15:0] inputs;
  logic [bpn::GROUP_W-1:0] stepped_group;
  localparam int STEP_W = bpn::GROUP_W + 6;
  logic [STEP_W-1:0] stepping;
  logic [bpn::WEIGHT_W:0] weights_read, weights_read_next;
  logic [8:0] conv1_read;
  logic [7:0] maps_read;
  logic done;
  logic [1:0] done_layer;
  logic [15:0] signs;
  logic [7:0] done_address;

  always_ff @(posedge clk) begin
    // Activations are read a clock before their weights, for the clock in which one of two maps is chosen.
    {stepped, stepping} <= {stepping[STEP_W-1], step, layer, group, is_bias, is_first, is_last};
    {stepped_layer, stepped_group, stepped_bias, stepped_first, stepped_last} <= stepping[STEP_W-2:0];
    from_conv1 <= {from_conv1[0], stepping[STEP_W-2-:2] == 2'd0};
    inputs <= from_conv1[1] ? conv1_input : maps_input;
    weights_read <= weights_read_next;
    if (host_read) begin
      weights_read_next <= {host_bank, host_address[3+:bpn::WEIGHT_W]};
      conv1_read <= {host_frame, host_address[7:0]};
      maps_read <= host_address[7:0];
    end else begin
      weights_read_next <= {bank, weight_address};
      conv1_read <= {frame, input_address};
      case (layer)
        2'd1: maps_read <= {1'b0, input_address[6:0]};
        2'd2: maps_read <= {2'b10, input_address[5:0]};
        default: maps_read <= {2'b11, input_address[5:0]};
      endcase
    end
    if (!rst_n) {stepped, stepping} <= '0;
  end

  bpn_ram #(
      .DEPTH(2 ** (bpn::WEIGHT_W + 1)),
      .LANES(8),
      .LANE (32)
  ) u_weights (
      .clk,
      .write(weight_write),
      .write_address({write_bank, write_address}),
      .write_data,
      .read_address(weights_read),
      .read_data(weights)
  );

  bpn_ram #(
      .DEPTH(512),
      .LANES(1),
      .LANE (16)
  ) u_conv1_map (
      .clk,
      .write(map_write),
      .write_address({map_half, map_address}),
      .write_data(map_word),
      .read_address(conv1_read),
      .read_data(conv1_input)
  );

  always_comb
    case (done_layer)
      2'd0: done_address = {1'b0, conv2_words};
      2'd1: done_address = {2'b10, conv3_words};
      default: done_address = {2'b11, 6'(done_group)};
    endcase

  bpn_ram #(
      .DEPTH(256),
      .LANES(1),
      .LANE (16)
  ) u_maps (
      .clk,
      .write(done && done_layer != 2'd3),
      .write_address(done_address),
      .write_data(signs),
      .read_address(maps_read),
      .read_data(maps_input)
  );

  bpn_xnor u_xnor (
      .clk,
      .rst_n,
      .step(stepped),
      .layer(stepped_layer),
      .group(stepped_group),
      .is_bias(stepped_bias),
      .is_first(stepped_first),
      .is_last(stepped_last),
      .inputs,
      .weights,
      .done,
      .done_layer,
      .done_group,
      .active(signs),
      .sums
  );

  // How far the layers' maps are.
  assign output_done = done && done_layer == 2'd3;

  always_ff @(posedge clk) begin
    if (done)
      case (done_layer)
        2'd0: conv2_words <= conv2_words + 1'b1;
        2'd1: conv3_words <= conv3_words + 1'b1;
        2'd2: fc1_words <= fc1_words + 1'b1;
        default: ;
      endcase
    if (clear || !rst_n) {conv2_words, conv3_words, fc1_words} <= '0;
  end
endmodule
