// Conv1 (8x8, stride 4, eight outputs) over the pixels as they come, without a frame or line memory for them.
//
// A block of 4x4 pixels belongs to 2x2 output positions, so that each beat adds to 32 sums at once. Of a position only
// its sums so far are kept, twice: of the output row that the image rows begin, and of the one that they complete.
// With weights of +1 and -1, o = 2 M - T, where M sums the pixels whose weight is +1 and T sums all.
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

    // A word of weights has, for the kernel's top and bottom, left and right half, and each channel, BYTES signs.
    input logic write_bank,
    input logic [bpn::BYTES-1:0] weight_write,
    input logic [bpn::BEAT_W+1:0] weight_address,
    input logic threshold_write,
    input logic [2:0] threshold_address,
    input logic [31:0] write_data,

    // The host's reads, in clocks without a beat: four clocks after the first of two.
    input logic host_read,
    input logic [bpn::BEAT_W+2:0] host_address,
    output logic [32*bpn::BYTES-1:0] host_weights,
    input logic [3:0] host_threshold_address,
    output logic [31:0] host_threshold,

    // Two positions of a row, eight channels each.
    output logic map_write,
    output logic map_half,
    output logic [7:0] map_address,
    output logic [15:0] map_word
);
  localparam int CHANNELS = 8;
  localparam int Q_W = bpn::BEAT_SUM_W;
  localparam int R_W = bpn::ROW_SUM_W;
  localparam int S_W = bpn::SUM_W;
  localparam int D_W = S_W + 3;
  localparam int SUMS = 2 * CHANNELS + 2;  // kept for a position: top and bottom, eight M and a T
  localparam int DEPTH = 2 + bpn::TREE;  // clocks from a beat to its sums

  // What goes along with a beat: its place, its frame.
  localparam int C_W = bpn::BLOCK_W + bpn::ROW_W + 4;
  logic [C_W-1:0] along[DEPTH+3];
  logic [DEPTH+2:0] valid;
  logic [8*bpn::BYTES-1:0] data[3];
  logic [9*bpn::PAIRS-1:0] pairs;  // of data[2]

  wire [bpn::BEAT_W+2:0] beat_address = {bank, row[1:0], beat};
  logic [bpn::BEAT_W+2:0] address;
  logic [32*bpn::BYTES-1:0] weights;

  bpn_ram #(
      .DEPTH(2 ** (bpn::BEAT_W + 3)),
      .LANES(bpn::BYTES),
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
    along[0] <= {half, bank, beat_last, beat == '0, row, block};
    valid[0] <= beat_valid;
    for (int i = 1; i < DEPTH + 3; i = i + 1) begin
      along[i] <= along[i-1];
      valid[i] <= valid[i-1];
    end
    if (!rst_n) valid <= '0;
  end

  // 32 masked sums of a beat, and the sum of all its bytes.
  logic [32*Q_W-1:0] masked;
  logic [Q_W-1:0] total;
  generate
    for (genvar i = 0; i < 32; i = i + 1) begin : gen_masked
      bpn_masked_sum u_sum (
          .clk,
          .bytes(data[2]),
          .pairs,
          .mask(weights[i*bpn::BYTES+:bpn::BYTES]),
          .sum(masked[i*Q_W+:Q_W])
      );
    end
  endgenerate
  bpn_masked_sum u_total (
      .clk,
      .bytes(data[2]),
      .pairs,
      .mask('1),
      .sum(total)
  );

  // Of a row of pixels: `left` sums a block as the left half of a position, `sum` what that position gets from the
  // row, once its right half, the next block, is added. Eight of a kernel's top, eight of its bottom, and T.
  wire fed = valid[DEPTH];
  wire fed_first = along[DEPTH][bpn::BLOCK_W+bpn::ROW_W];
  logic [17*R_W-1:0] left, sum;
  logic [17*R_W-1:0] left_in, right_in;
  generate
    for (genvar i = 0; i < 16; i = i + 1) begin : gen_in
      localparam int LANE = (i / CHANNELS) * 2;
      assign left_in[i*R_W+:R_W] = R_W'(masked[(LANE*CHANNELS+i%CHANNELS)*Q_W+:Q_W]);
      assign right_in[i*R_W+:R_W] = R_W'(masked[((LANE+1)*CHANNELS+i%CHANNELS)*Q_W+:Q_W]);
    end
    assign left_in[16*R_W+:R_W]  = R_W'(total);
    assign right_in[16*R_W+:R_W] = R_W'(total);
    for (genvar i = 0; i < 17; i = i + 1) begin : gen_row
      always_ff @(posedge clk)
        if (fed) begin
          left[i*R_W+:R_W] <= (fed_first ? '0 : left[i*R_W+:R_W]) + left_in[i*R_W+:R_W];
          sum[i*R_W+:R_W] <= (fed_first ? left[i*R_W+:R_W] : sum[i*R_W+:R_W]) + right_in[i*R_W+:R_W];
        end
    end
  endgenerate

  // A block's last beat completes what the position one to the left gets from this row.
  wire [bpn::BLOCK_W-1:0] early_block = along[DEPTH-1][bpn::BLOCK_W-1:0];
  wire [bpn::BLOCK_W-1:0] summed_block = along[DEPTH+1][bpn::BLOCK_W-1:0];
  wire [bpn::ROW_W-1:0] summed_row = along[DEPTH+1][bpn::BLOCK_W+:bpn::ROW_W];
  wire summed = valid[DEPTH+1] && along[DEPTH+1][bpn::BLOCK_W+bpn::ROW_W+1] && summed_block != '0;
  logic first_of_four;
  always_ff @(posedge clk) first_of_four <= along[DEPTH][bpn::BLOCK_W+:2] == 2'd0;

  logic [SUMS*S_W-1:0] kept, updated;
  logic updated_valid, updated_complete;
  logic [bpn::BLOCK_W-1:0] position;

  bpn_ram #(
      .DEPTH(2 ** bpn::BLOCK_W),
      .LANES(1),
      .LANE (SUMS * S_W)
  ) u_kept (
      .clk,
      .write(updated_valid),
      .write_address(position),
      .write_data(updated),
      .read_address(early_block - 1'b1),
      .read_data(kept)
  );

  generate
    for (genvar i = 0; i < 9; i = i + 1) begin : gen_kept
      localparam int TOP = i * S_W;
      localparam int BOTTOM = (9 + i) * S_W;
      localparam int FROM_TOP = (i < CHANNELS ? i : 16) * R_W;
      localparam int FROM_BOTTOM = (CHANNELS + i) * R_W;  // T, the last, is the same for both
      wire [S_W-1:0] top = first_of_four ? '0 : kept[TOP+:S_W];
      wire [S_W-1:0] bottom = first_of_four ? kept[TOP+:S_W] : kept[BOTTOM+:S_W];
      always_ff @(posedge clk) begin
        updated[TOP+:S_W] <= top + S_W'(sum[FROM_TOP+:R_W]);
        updated[BOTTOM+:S_W] <= bottom + S_W'(sum[FROM_BOTTOM+:R_W]);
      end
    end
  endgenerate

  // The eighth row completes a position: active if 2 M - T >= tau.
  logic complete;
  logic [S_W-1:0] complete_t;
  logic signed [D_W-1:0] distance[CHANNELS];
  logic [CHANNELS-1:0] active, active_even;
  logic active_valid;
  logic [2:0] odd, halves;
  logic [CHANNELS*32-1:0] held;

  generate
    for (genvar i = 0; i < CHANNELS; i = i + 1) begin : gen_channel
      logic signed [bpn::TAU_W-1:0] thresholds[2];
      logic signed [bpn::TAU_W-1:0] threshold;
      wire signed [D_W-1:0] difference = distance[i] - $signed({3'b0, complete_t});
      always_ff @(posedge clk) begin
        if (threshold_write && threshold_address == 3'(i))
          thresholds[write_bank] <= write_data[bpn::TAU_W-1:0];
        threshold <= thresholds[along[DEPTH+1][bpn::BLOCK_W+bpn::ROW_W+2]];
        distance[i] <= $signed({2'b0, updated[(9+i)*S_W+:S_W], 1'b0}) - D_W'(threshold);
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
    updated_valid <= summed;
    updated_complete <= summed && summed_row[1:0] == 2'd3 && summed_row > bpn::ROW_W'(3);
    position <= summed_block - 1'b1;
    odd <= {odd[1:0], !summed_block[0]};
    halves <= {halves[1:0], along[DEPTH+1][C_W-1]};
    complete <= updated_complete;
    complete_t <= updated[17*S_W+:S_W];
    active_valid <= complete;
    if (!odd[2]) active_even <= active;
    if (map_write) map_address <= map_address == 8'(bpn::CONV1_WORDS - 1) ? '0 : map_address + 1'b1;
    if (!rst_n) begin
      {updated_valid, updated_complete, complete, active_valid} <= '0;
      map_address <= '0;
    end
  end
endmodule
