// Takes a weight set as a stream of 32-bit words into the bank that the set names, and verifies it:
//
//   identity | sizes, bank | epoch | conv1's weights, thresholds | the engine's words | CRC-32 of all before
//
// A bank counts for nothing from the moment its set begins to the moment the whole set was right.
// A set for the bank that runs is refused; for one that a frame in flight still needs, it waits.
module bpn_loader (
    input logic clk,
    input logic rst_n,

    input logic [31:0] s_tdata,
    input logic s_tvalid,
    output logic s_tready,
    input logic s_tlast,

    input logic [1:0] selected,  // by bank
    input logic [1:0] in_use,  // by bank

    output logic busy,
    output logic begun,  // from this clock on the bank's old content is gone
    output logic begun_bank,
    output logic bank,
    output logic verified,  // the bank now holds the set
    output logic [bpn::GEOMETRY_W-1:0] geometry,
    output logic [31:0] epoch,
    output logic [31:0] crc,
    output logic [3:0] refused,  // why: bad identity, sizes or bank, length, CRC

    output logic [bpn::CONV1_LANES-1:0] conv1_write,
    output logic [bpn::BEAT_W+1:0] conv1_address,
    output logic threshold_write,
    output logic [2:0] threshold_address,
    output logic [7:0] engine_write,
    output logic [bpn::WEIGHT_W-1:0] engine_address,
    output logic [31:0] write_data
);
  localparam logic [2:0] IDENTITY = 0, SIZES = 1, EPOCH = 2, CONV1 = 3, THRESHOLDS = 4, ENGINE = 5, CRC = 6, DROP = 7;
  localparam logic [3:0] WRONG_IDENTITY = 1, WRONG_SIZES = 2, WRONG_LENGTH = 4, WRONG_CRC = 8;
  localparam int WEIGHT_W = bpn::WEIGHT_W;

  logic [2:0] state;
  logic [bpn::CONV1_LANES-1:0] conv1_lane;  // one-hot
  logic [1:0] conv1_row;
  logic [bpn::BEAT_W-1:0] conv1_beat;
  logic [2:0] lane;
  logic [WEIGHT_W-1:0] fc1_end, fc2_words, last_word, word;

  // The word that is looked at: a register, so that whatever is in front of the stream is not in this clock. Where it
  // decides something it is looked at for a clock before it is taken.
  logic have, last, known;
  logic [31:0] set_word;
  wire decides = state == SIZES || state == EPOCH || state == CRC;
  wire taken = have && (!decides || known);
  assign s_tready = !have || taken;

  // Sizes, as the second word has them, and what follows from them.
  logic fit;  // what is known in the clock in which they are taken
  wire [4:0] channels = set_word[4:0];
  wire [7:0] actions = set_word[15:8];
  wire [15:0] nodes = set_word[31:16];
  wire stacked = set_word[6];
  wire sizes_fit = channels != '0 && channels <= 5'(bpn::MAX_CHANNELS) && !set_word[5]
      && (!stacked || (bpn::CONV1_LANES == 2 * bpn::BYTES && !channels[0]))
      && actions >= 8'd2 && actions <= 8'(bpn::MAX_ACTIONS) && nodes != '0 && nodes <= 16'(bpn::MAX_HIDDEN_UNITS);
  wire nodes_left = nodes[3:0] != 4'd0;  // beyond whole groups of sixteen
  wire actions_left = actions[3:0] != 4'd0;
  wire [4:0] channels_less_1 = (stacked ? channels >> 1 : channels) - 5'd1;  // of what is sent
  wire [WEIGHT_W-1:0] groups = WEIGHT_W'(geometry[bpn::G_NODE_GROUPS+:bpn::GROUP_W]);
  wire [bpn::ACTION_GROUP_W-1:0] action_groups = geometry[bpn::G_ACTION_GROUPS+:bpn::ACTION_GROUP_W];
  wire [bpn::BEAT_W-1:0] last_beat = geometry[bpn::G_LAST_BEAT+:bpn::BEAT_W];

  assign begun = fit && !selected[set_word[7]];
  assign begun_bank = set_word[7];
  assign busy = state != IDENTITY;

  bpn_crc32 u_crc (
      .clk,
      .clear(state == IDENTITY),
      .enable(taken && state != CRC),  // the bank keeps it
      .word(set_word),
      .crc
  );

  always_ff @(posedge clk) begin
    if (s_tready) begin
      have <= s_tvalid;
      set_word <= s_tdata;
      last <= s_tlast;
    end
    known <= have && !known && (state == SIZES || state == CRC || (state == EPOCH && !in_use[bank]));
    fit <= have && !known && state == SIZES && sizes_fit && !last;
    verified <= 1'b0;
    refused <= '0;
    conv1_write <= '0;
    threshold_write <= 1'b0;
    engine_write <= '0;
    write_data <= set_word;
    conv1_address <= {conv1_row, conv1_beat};
    threshold_address <= lane;
    engine_address <= word;
    fc1_end <= (groups << 5) + (groups << 4) + (groups << 1) + WEIGHT_W'(bpn::FC1_WEIGHTS - 1);
    fc2_words <= (action_groups[0] ? groups : '0) + (action_groups[1] ? groups << 1 : '0) + (action_groups[2] ? groups << 2 : '0);
    last_word <= fc1_end + fc2_words;

    if (taken) begin
      case (state)
        IDENTITY: begin
          state <= SIZES;
          if (set_word != bpn::SET_IDENTITY) begin
            refused <= WRONG_IDENTITY;
            state <= DROP;
          end
        end
        SIZES: begin
          bank <= set_word[7];
          geometry <= {
            bpn::BEAT_W'({channels_less_1, 2'b11} >> $clog2(bpn::BYTES)),
            stacked,
            bpn::GROUP_W'(nodes >> 4) + bpn::GROUP_W'(nodes_left),
            bpn::ACTION_GROUP_W'(actions >> 4) + bpn::ACTION_GROUP_W'(actions_left),
            nodes[10:0],
            actions[6:0],
            channels
          };
          state <= EPOCH;
          if (!begun) begin
            refused <= WRONG_SIZES;
            state <= DROP;
          end
        end
        EPOCH: begin
          epoch <= set_word;
          conv1_lane <= 1;
          {conv1_row, conv1_beat, lane, word} <= '0;
          state <= CONV1;
        end
        CONV1: begin
          conv1_write <= conv1_lane;
          conv1_lane <= conv1_lane << 1;
          if (conv1_lane[geometry[bpn::G_STACKED]?bpn::CONV1_LANES-1 : bpn::BYTES-1]) begin
            conv1_lane <= 1;
            conv1_beat <= conv1_beat + 1'b1;
            if (conv1_beat == last_beat) begin
              conv1_beat <= '0;
              conv1_row <= conv1_row + 1'b1;
              if (conv1_row == 2'd3) state <= THRESHOLDS;
            end
          end
        end
        THRESHOLDS: begin
          threshold_write <= 1'b1;
          lane <= lane + 1'b1;
          if (lane == 3'd7) state <= ENGINE;
        end
        ENGINE: begin
          engine_write <= 8'd1 << lane;
          lane <= lane + 1'b1;
          if (lane == 3'd7) begin
            word <= word + 1'b1;
            if (word == last_word) state <= CRC;
          end
        end
        CRC: begin
          state <= IDENTITY;
          if (!last) begin
            refused <= WRONG_LENGTH;
            state <= DROP;
          end else if (set_word != crc) refused <= WRONG_CRC;
          else verified <= 1'b1;
        end
        default: ;
      endcase
      if (last && state != CRC) begin
        state <= IDENTITY;
        if (state != DROP) refused <= WRONG_LENGTH;
      end
    end
    if (!rst_n) begin
      state <= IDENTITY;
      {have, known, fit, verified, refused, conv1_write, threshold_write, engine_write} <= '0;
    end
  end
endmodule
