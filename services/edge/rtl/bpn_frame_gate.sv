// Lets exactly one frame's beats through, in raster order with their place in the frame, whatever comes in.
// A frame that ends early is filled up with zeros, one that goes on too long is cut; both are marked misaligned, so that
// whatever follows knows whole frames alone and need never give one up in the middle.
module bpn_frame_gate
(
    input logic clk,
    input logic rst_n,

    input logic [8*bpn::BYTES-1:0] s_tdata,  // pixels: row, column, channel; lowest byte first
    input logic s_tvalid,
    output logic s_tready,
    input logic s_tlast,

    input logic go,  // a frame may begin
    input logic [bpn::BEAT_W-1:0] last_beat,  // of a block of four pixels, for the frame that begins
    input logic hold,  // no beat in the next clock

    output logic start,  // in the clock before a frame's first beat can come
    output logic done,  // with a frame's last beat
    output logic misaligned,  // with `done`: the frame was too short or too long

    output logic beat_valid,
    output logic [8*bpn::BYTES-1:0] beat_data,
    output logic [bpn::BEAT_W-1:0] beat,
    output logic beat_last,  // of its block
    output logic [bpn::BLOCK_W-1:0] block,
    output logic [bpn::ROW_W-1:0] row
);
  localparam logic [1:0] IDLE = 0, STREAM = 1, FILL = 2, DRAIN = 3;
  logic [1:0] state;
  logic held;
  logic [bpn::BEAT_W-1:0] final_beat;

  wire taken = s_tvalid && s_tready;
  wire block_last = block == bpn::BLOCK_W'(bpn::BLOCKS - 1);
  wire frame_last = beat_last && block_last && row == bpn::ROW_W'(bpn::IMAGE - 1);

  assign start = state == IDLE && go && s_tvalid;
  assign s_tready = (state == STREAM && !held) || state == DRAIN;
  assign beat_valid = (state == STREAM && taken) || (state == FILL && !held);
  assign beat_data = state == FILL ? '0 : s_tdata;
  assign beat_last = beat == final_beat;
  assign done = beat_valid && frame_last;
  assign misaligned = state == FILL || !s_tlast;

  always_ff @(posedge clk) begin
    held <= hold;
    if (!rst_n) state <= IDLE;
    else
      case (state)
        IDLE: if (start) state <= STREAM;
        STREAM:
        if (taken) begin
          if (frame_last) state <= s_tlast ? IDLE : DRAIN;
          else if (s_tlast) state <= FILL;
        end
        FILL: if (done) state <= IDLE;
        default: if (taken && s_tlast) state <= IDLE;
      endcase

    if (start) begin
      final_beat <= last_beat;
      beat <= '0;
      block <= '0;
      row <= '0;
    end else if (beat_valid) begin
      beat <= beat_last ? '0 : beat + 1'b1;
      if (beat_last) begin
        block <= block_last ? '0 : block + 1'b1;
        if (block_last) row <= row + 1'b1;
      end
    end
  end
endmodule
