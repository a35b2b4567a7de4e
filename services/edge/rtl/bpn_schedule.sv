// Decides what the XNOR engine does next, job by job, as soon as a job's inputs are there: an output position of conv2
// or conv3, one input word of FC(N) for all its outputs (so that almost nothing is left to do after the last pixel),
// sixteen outputs of FC(|A|). A job is a run of steps; each step is a word of activations and a word of weights.
//
// Weights lie in the order in which a frame needs them, layer after layer; a bias, where there is one, before.
module bpn_schedule (
    input logic clk,
    input logic rst_n,

    input logic active,  // a frame is in the engine
    input logic [bpn::GROUP_W-1:0] node_groups,  // of sixteen, of that frame's network
    input logic [bpn::ACTION_GROUP_W-1:0] action_groups,
    input logic clear,  // the frame is done

    // What has been written of the frame.
    input logic [7:0] conv1_words,
    input logic [6:0] conv2_words,
    input logic [5:0] conv3_words,
    input logic [bpn::GROUP_W-1:0] fc1_words,

    input logic hold,  // begin no job: the host wants the memories
    output logic idle,  // it does, and makes no step in this clock

    output logic step,
    output logic [1:0] layer,  // 0 conv2, 1 conv3, 2 FC(N), 3 FC(|A|)
    output logic [7:0] map_address,  // in the layer's input map
    output logic [bpn::WEIGHT_W-1:0] weight_address,
    output logic [bpn::GROUP_W-1:0] group,  // which sixteen outputs
    output logic is_bias,  // the word of weights has biases
    output logic is_first,  // begins a sum from nothing
    output logic is_last  // completes a sum
);
  localparam logic [1:0] CONV2 = 0, CONV3 = 1, FC1 = 2, FC2 = 3;
  localparam int GROUP_W = bpn::GROUP_W;
  localparam int WEIGHT_W = bpn::WEIGHT_W;

  // The next job of each layer. A convolution's window begins at word `origin` and is whole once the layer before has
  // written `REACH` more.
  localparam int CONV2_PITCH = 10, CONV2_REACH = 3 * CONV2_PITCH + 2;
  localparam int CONV3_PITCH = 9, CONV3_REACH = 2 * CONV3_PITCH + 3;
  logic [7:0] conv2_origin, conv2_need;
  logic [6:0] conv3_origin, conv3_need;
  logic [3:0] conv2_column;
  logic [2:0] conv3_column;
  logic [5:0] fc1_position;  // 0: the biases
  logic [bpn::ACTION_GROUP_W-1:0] fc2_group;
  logic [WEIGHT_W-1:0] fc_weights;  // FC(N)'s, and after them FC(|A|)'s, are walked through once
  logic conv2_ready, conv3_ready, fc1_ready, fc2_ready;

  // The job in hand.
  logic busy, ends, padding, held;  // ends: with the step in this clock
  logic [2:0] steps;  // 0 to 4, then no more
  logic [1:0] column;
  logic [GROUP_W-1:0] left;  // steps after this one, of a fully connected layer
  logic [3:0] conv_left;
  logic fc1_bias, fc1_last;

  wire conv = !layer[1];
  wire ends_next = conv ? conv_left == 4'd1 : left == GROUP_W'(1);
  wire over = busy && (padding || ends) && steps[2];
  wire begin_job = active && !held && (!busy || over) && !clear;
  assign idle = held && !busy;
  assign step = busy && !padding;

  always_ff @(posedge clk) begin
    held <= hold;
    conv2_ready <= conv2_origin < 8'd170 && conv1_words >= conv2_need;
    conv3_ready <= conv3_origin < 7'd63 && conv2_words >= conv3_need;
    fc1_ready <= fc1_position < 6'd50 && conv3_words >= fc1_position;
    fc2_ready <= fc2_group < action_groups && fc1_words == node_groups;
    conv2_need <= conv2_origin + 8'(CONV2_REACH);
    conv3_need <= conv3_origin + 7'(CONV3_REACH);

    if (busy && !steps[2]) steps <= steps + 1'b1;
    if (step) begin
      weight_address <= weight_address + 1'b1;
      is_bias <= fc1_bias;
      is_first <= 1'b0;
      if (conv) begin
        conv_left <= conv_left - 1'b1;
        is_last <= ends_next;
        if (!is_bias) begin
          column <= column + 1'b1;
          map_address <= map_address + 1'b1;
          if (column == (layer == CONV2 ? 2'd1 : 2'd2)) begin
            column <= '0;
            map_address <= map_address + (layer == CONV2 ? 8'(CONV2_PITCH - 1) : 8'(CONV3_PITCH - 2));
          end
        end
      end else begin
        left <= left - 1'b1;
        is_last <= layer == FC1 ? fc1_last : ends_next;
        if (layer == FC1) group <= group + 1'b1;
        else map_address <= map_address + 1'b1;
      end
      ends <= ends_next;
      padding <= ends;
    end
    if (over) busy <= 1'b0;

    if (begin_job && (fc2_ready || fc1_ready || conv3_ready || conv2_ready)) begin
      busy <= 1'b1;
      padding <= 1'b0;
      ends <= (fc2_ready || fc1_ready) && node_groups == GROUP_W'(1);
      steps <= 3'd1;
      column <= '0;
      group <= '0;
      left <= node_groups - 1'b1;
      is_first <= 1'b0;
      is_last <= 1'b0;
      fc1_bias <= 1'b0;
      if (fc2_ready) begin
        layer <= FC2;
        map_address <= '0;
        weight_address <= fc_weights;
        fc_weights <= fc_weights + WEIGHT_W'(node_groups);
        group <= GROUP_W'(fc2_group);
        is_bias <= 1'b0;
        is_first <= 1'b1;
        is_last <= node_groups == GROUP_W'(1);
        fc2_group <= fc2_group + 1'b1;
      end else if (fc1_ready) begin
        layer <= FC1;
        map_address <= 8'(fc1_position) - 8'd1;
        weight_address <= fc_weights;
        fc_weights <= fc_weights + WEIGHT_W'(node_groups);
        is_bias <= fc1_position == '0;
        fc1_bias <= fc1_position == '0;
        fc1_last <= fc1_position == 6'd49;
        is_last <= fc1_position == 6'd49;
        fc1_position <= fc1_position + 1'b1;
      end else if (conv3_ready) begin
        layer <= CONV3;
        map_address <= 8'(conv3_origin);
        weight_address <= WEIGHT_W'(bpn::CONV3_WEIGHTS);
        conv_left <= 4'd9;
        is_bias <= 1'b1;
        conv3_column <= conv3_column == 3'd6 ? '0 : conv3_column + 1'b1;
        conv3_origin <= conv3_origin + (conv3_column == 3'd6 ? 7'd3 : 7'd1);
      end else begin
        layer <= CONV2;
        map_address <= conv2_origin;
        weight_address <= '0;
        conv_left <= 4'd8;
        is_bias <= 1'b1;
        conv2_column <= conv2_column == 4'd8 ? '0 : conv2_column + 1'b1;
        conv2_origin <= conv2_origin + (conv2_column == 4'd8 ? 8'd12 : 8'd1);
      end
    end

    if (!rst_n || clear) begin
      busy <= 1'b0;
      {conv2_ready, conv3_ready, fc1_ready, fc2_ready} <= '0;
      {conv2_origin, conv3_origin, conv2_column, conv3_column, fc1_position, fc2_group} <= '0;
      fc_weights <= WEIGHT_W'(bpn::FC1_WEIGHTS);
    end
  end
endmodule
