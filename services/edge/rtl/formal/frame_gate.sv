// Of bpn_frame_gate, whatever comes in: its place in the frame stays within it, beats come only within a frame, every
// frame that begins has its last beat before the next begins, and what comes out of the stream is what went in.
module frame_gate (
    input logic clk,
    input logic [8*bpn::BYTES-1:0] data,
    input logic valid, last, go, hold,
    input logic [bpn::BEAT_W-1:0] last_beat
);
  logic reset_done = 1'b0;
  always_ff @(posedge clk) reset_done <= 1'b1;
  wire rst_n = reset_done;

  logic ready, start, done, misaligned, beat_valid, beat_last;
  logic [8*bpn::BYTES-1:0] beat_data;
  logic [bpn::BEAT_W-1:0] beat;
  logic [bpn::BLOCK_W-1:0] block;
  logic [bpn::ROW_W-1:0] row;

  bpn_frame_gate u_gate (
      .clk, .rst_n, .s_tdata(data), .s_tvalid(valid), .s_tready(ready), .s_tlast(last), .go, .last_beat, .hold, .start,
      .done, .misaligned, .beat_valid, .beat_data, .beat, .beat_last, .block, .row
  );

  // Connected by prove.py.
  (* keep *) wire [1:0] gate_state;
  (* keep *) wire gate_held;
  (* keep *) wire [bpn::BEAT_W-1:0] gate_final_beat;

  logic in_frame, was_hold;
  always_ff @(posedge clk) begin
    was_hold <= hold;
    if (!rst_n) in_frame <= 1'b0;
    else if (start) in_frame <= 1'b1;
    else if (done) in_frame <= 1'b0;
  end

  always_comb
    if (reset_done) begin
      if (beat_valid) assert (in_frame);
      if (start) assert (!in_frame && go);
      assert (in_frame == (gate_state == 2'd1 || gate_state == 2'd2));
      if (in_frame) assert (beat <= gate_final_beat && block < bpn::BLOCKS && row < bpn::IMAGE);
      if (done) assert (beat_last && block == bpn::BLOCKS - 1 && row == bpn::IMAGE - 1);
      if (was_hold && gate_held) assert (!beat_valid);
      if (beat_valid && gate_state == 2'd1) assert (valid && ready && beat_data == data);
      if (gate_state == 2'd0) assert (!ready);
    end
endmodule
