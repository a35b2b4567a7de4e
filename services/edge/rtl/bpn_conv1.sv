// Conv1 (8x8, stride 4, eight outputs) over the pixels as they come, without a frame or line memory for them.
//
// With weights of +1 and -1, o = 2 M - T, where M sums the pixels whose weight is +1 and T sums all. A build that keeps
// frames has two sets of weights: a beat also adds to what its frame will be to the next one, as the earlier of the two.
module bpn_conv1 (
    input logic clk,
    input logic rst_n,

    input logic beat_valid,
    input logic [8*bpn::BYTES-1:0] beat_data,
    input logic [bpn::BEAT_W-1:0] beat,
    input logic beat_last,
    input logic [bpn::BLOCK_W-1:0] block,
    input logic [bpn::ROW_W-1:0] row,
    input logic bank,  // of the frame
    input logic half,  // of the map's memory that the frame has
    input logic stacked,  // the frame comes after one that belongs to it

    // A word of weights has, for the kernel's top and bottom, left and right half, and each channel, BYTES signs; with two
    // frames first the newer one's.
    input logic write_bank,
    input logic [bpn::CONV1_LANES-1:0] weight_write,
    input logic [bpn::BEAT_W+1:0] weight_address,
    input logic threshold_write,
    input logic [2:0] threshold_address,
    input logic [31:0] write_data,

    // The host's reads, in clocks without a beat: four clocks after the first of two.
    input logic host_read,
    input logic [bpn::BEAT_W+2:0] host_address,
    output logic [32*bpn::CONV1_LANES-1:0] host_weights,
    input logic [3:0] host_threshold_address,
    output logic [31:0] host_threshold,

    // Two positions of a row, eight channels each.
    output logic map_write,
    output logic map_half,
    output logic [7:0] map_address,
    output logic [15:0] map_word
);
  localparam int CHANNELS = 8;
  localparam int S_W = bpn::SUM_W;
  localparam int D_W = S_W + 3;
  localparam int DEPTH = 2 + bpn::TREE;  // clocks from a beat to its sums

  // What goes along with a beat: its place, its frame.
  localparam int C_W = bpn::BLOCK_W + bpn::ROW_W + 5;
  logic [C_W-1:0] along[DEPTH+3];
  logic [DEPTH+2:0] valid;
  logic [8*bpn::BYTES-1:0] data[3];
  logic [9*bpn::PAIRS-1:0] pairs;  // of data[2]

  wire [bpn::BEAT_W+2:0] beat_address = {bank, row[1:0], beat};
  logic [bpn::BEAT_W+2:0] address;
  logic [32*bpn::CONV1_LANES-1:0] weights;

  bpn_ram #(
      .DEPTH(2 ** (bpn::BEAT_W + 3)),
      .LANES(bpn::CONV1_LANES),
      .LANE (32)
  ) u_weights (
      .clk,
      .write(weight_write),
      .write_address({write_bank, weight_address}),
      .write_data,
      .read_address(address),
      .read_data(weights)
  );
  assign host_weights = weights;

  always_ff @(posedge clk) begin
    address <= host_read ? host_address : beat_address;
    data[0] <= beat_data;
    data[1] <= data[0];
    data[2] <= data[1];
    for (int i = 0; i < bpn::BYTES / 2; i = i + 1)
      pairs[9*i+:9] <= {1'b0, data[1][16*i+:8]} + {1'b0, data[1][16*i+8+:8]};
    if (bpn::BYTES == 1) pairs <= '0;
    along[0] <= {half, stacked, bank, beat_last, beat == '0, row, block};
    valid[0] <= beat_valid;
    for (int i = 1; i < DEPTH + 3; i = i + 1) begin
      along[i] <= along[i-1];
      valid[i] <= valid[i-1];
    end
    if (!rst_n) valid <= '0;
  end

  // A block's last beat completes what the position one to the left gets from this row.
  wire fed = valid[DEPTH];
  wire fed_first = along[DEPTH][bpn::BLOCK_W+bpn::ROW_W];
  wire [bpn::BLOCK_W-1:0] early_position = along[DEPTH-1][bpn::BLOCK_W-1:0] - 1'b1;
  wire [bpn::BLOCK_W-1:0] summed_block = along[DEPTH+1][bpn::BLOCK_W-1:0];
  wire [bpn::ROW_W-1:0] summed_row = along[DEPTH+1][bpn::BLOCK_W+:bpn::ROW_W];
  wire summed = valid[DEPTH+1] && along[DEPTH+1][bpn::BLOCK_W+bpn::ROW_W+1] && summed_block != '0;
  logic first_of_four, updated_valid, updated_complete, complete;
  logic [bpn::BLOCK_W-1:0] position;
  logic [9*S_W-1:0] updated;
  logic [CHANNELS*bpn::EARLIER_W-1:0] earlier;  // o of the earlier frame's channels

  bpn_window_sums u_sums (
      .clk,
      .bytes(data[2]),
      .pairs,
      .weights(weights[0+:32*bpn::BYTES]),
      .fed,
      .fed_first,
      .early_position,
      .first_of_four,
      .updated(updated_valid),
      .position,
      .sums(updated)
  );

  generate
    if (bpn::CONV1_LANES == 2 * bpn::BYTES) begin : gen_earlier
      bpn_earlier_frame u_earlier (
          .clk,
          .rst_n,
          .bytes(data[2]),
          .pairs,
          .weights(weights[32*bpn::BYTES+:32*bpn::BYTES]),
          .fed,
          .fed_first,
          .early(valid[DEPTH-1] && along[DEPTH-1][bpn::BLOCK_W+bpn::ROW_W+1]),
          .early_position,
          .early_row(along[DEPTH-1][bpn::BLOCK_W+:bpn::ROW_W]),
          .first_of_four,
          .updated(updated_valid),
          .position,
          .complete,
          .earlier
      );
    end else begin : gen_alone
      assign earlier = '0;
    end
  endgenerate

  // The eighth row completes a position: active if 2 M - T >= tau, less what the earlier frame's o is.
  logic [S_W-1:0] complete_t;
  logic signed [D_W-1:0] distance[CHANNELS];
  logic [CHANNELS-1:0] active, active_even;
  logic active_valid;
  logic [2:0] odd, halves;
  logic [CHANNELS*32-1:0] held;

  generate
    for (genvar i = 0; i < CHANNELS; i = i + 1) begin : gen_channel
      logic signed [bpn::TAU_W-1:0] thresholds[2];
      logic signed [bpn::TAU_W:0] threshold;
      wire signed [bpn::EARLIER_W-1:0] added = earlier[i*bpn::EARLIER_W+:bpn::EARLIER_W];
      wire signed [D_W-1:0] difference = distance[i] - $signed({3'b0, complete_t});
      always_ff @(posedge clk) begin
        if (threshold_write && threshold_address == 3'(i))
          thresholds[write_bank] <= write_data[bpn::TAU_W-1:0];
        threshold <= (bpn::TAU_W + 1)'(thresholds[along[DEPTH+1][bpn::BLOCK_W+bpn::ROW_W+2]])
            - (along[DEPTH+1][C_W-2] ? (bpn::TAU_W + 1)'(added) : '0);
        distance[i] <= $signed({2'b0, updated[i*S_W+:S_W], 1'b0}) - D_W'(threshold);
        active[i] <= !difference[D_W-1];
      end
      assign held[i*32+:32] = 32'(thresholds[host_threshold_address[3]]);
    end
  endgenerate
  assign host_threshold = held[host_threshold_address[2:0]*32+:32];
  assign map_write = active_valid && odd[2];
  assign map_half = halves[2];
  assign map_word = {active, active_even};

  always_ff @(posedge clk) begin
    first_of_four <= along[DEPTH][bpn::BLOCK_W+:2] == 2'd0;
    updated_valid <= summed;
    updated_complete <= summed && summed_row[1:0] == 2'd3 && summed_row > bpn::ROW_W'(3);
    position <= summed_block - 1'b1;
    odd <= {odd[1:0], !summed_block[0]};
    halves <= {halves[1:0], along[DEPTH+1][C_W-1]};
    complete <= updated_complete;
    complete_t <= updated[8*S_W+:S_W];
    active_valid <= complete;
    if (!odd[2]) active_even <= active;
    if (map_write) map_address <= map_address == 8'(bpn::CONV1_WORDS - 1) ? '0 : map_address + 1'b1;
    if (!rst_n) begin
      {updated_valid, updated_complete, complete, active_valid} <= '0;
      map_address <= '0;
    end
  end
endmodule
