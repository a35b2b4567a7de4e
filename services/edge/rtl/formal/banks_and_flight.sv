// What has to hold of banks, loader and frames in flight whatever comes in; proven by prove.py:
//
//   - no frame begins with, and no frame in flight uses, a bank that is not wholly verified;
//   - a bank that a frame in flight uses, or that is selected, is not written;
//   - a frame keeps its bank to its end;
//   - what is kept of a frame counts for the next one only if that frame was whole, and is of the same bank with the same set;
//   - a set counts as verified only by its CRC, in its last word;
//   - at most two frames are in flight.
//
// The loader's parse of a set is left to itself: any word may come at any time, and the CRC may be right or wrong.
module banks_and_flight (
    input logic clk,
    input logic [31:0] word,
    input logic word_valid, word_last, select, begin_frame, finish_frame, pixels_end, misaligned,
    input logic [1:0] select_banks,
    input logic [bpn::G_STACKED:0] start_geometry
);
  logic reset_done = 1'b0;
  always_ff @(posedge clk) reset_done <= 1'b1;
  wire rst_n = reset_done;

  logic word_ready, busy, begun, begun_bank, load_bank, verified, select_refused;
  logic [bpn::GEOMETRY_W-1:0] geometry;
  logic [31:0] epoch, crc, write_data;
  logic [3:0] refused;
  logic [bpn::CONV1_LANES-1:0] conv1_write;
  logic [bpn::BEAT_W+1:0] conv1_address;
  logic threshold_write;
  logic [2:0] threshold_address;
  logic [7:0] engine_write;
  logic [bpn::WEIGHT_W-1:0] engine_address;
  logic [1:0] valid, selected, in_use;
  logic [2*bpn::GEOMETRY_W-1:0] geometries;
  logic [63:0] epochs, crcs;
  logic full, newest, newest_bank, active, oldest, oldest_bank, oldest_misaligned;
  logic newest_stacked, oldest_alone;
  logic [bpn::G_STACKED-1:0] oldest_geometry;

  // As bpn_frame_gate and bpn_schedule do: a frame begins only so, after the pixels of the one before, and only a frame in
  // flight ends.
  logic in_frame;
  wire start = begin_frame && selected != '0 && !full && !in_frame;
  wire ends = pixels_end && in_frame;
  wire finish = finish_frame && active;

  bpn_loader u_loader (
      .clk, .rst_n, .s_tdata(word), .s_tvalid(word_valid), .s_tready(word_ready), .s_tlast(word_last),
      .selected, .in_use, .busy, .begun, .begun_bank, .bank(load_bank), .verified, .geometry, .epoch, .crc, .refused,
      .conv1_write, .conv1_address, .threshold_write, .threshold_address, .engine_write, .engine_address, .write_data
  );
  bpn_banks u_banks (
      .clk, .rst_n, .begun, .begun_bank, .verified, .load_bank, .load_geometry(geometry), .load_epoch(epoch),
      .load_crc(crc), .select, .select_banks, .select_refused, .valid, .selected, .geometries, .epochs, .crcs
  );
  bpn_flight u_flight (
      .clk, .rst_n, .start, .start_bank(selected[1]), .start_geometry, .forget(select), .end_of_pixels(ends),
      .end_misaligned(misaligned), .finish, .full, .in_use, .newest, .newest_bank, .active, .oldest, .oldest_bank,
      .oldest_misaligned, .newest_stacked, .oldest_alone, .oldest_geometry
  );

  // Connected by prove.py.
  (* keep *) wire [2:0] loader_state;
  (* keep *) wire [1:0] flight_count;
  (* keep *) wire flight_kept, flight_keeps;
  (* keep *) wire loader_taken, loader_last;
  (* keep *) wire [31:0] loader_word;

  wire writes = conv1_write != '0 || threshold_write || engine_write != '0;

  // The bank of the frame that began last, kept here on its own.
  logic shadow_bank, shadow_oldest, was_active, was_finish;
  always_ff @(posedge clk) begin
    if (start) shadow_bank <= selected[1];
    shadow_oldest <= oldest_bank;
    was_active <= active && rst_n;
    was_finish <= finish;
  end

  // Of the frame that began last: whether its pixels were whole, and whether its bank's set is another one since.
  logic was_whole, was_replaced;
  always_ff @(posedge clk) begin
    if (start) was_replaced <= 1'b0;
    else if (begun && begun_bank == shadow_bank) was_replaced <= 1'b1;
    if (ends) was_whole <= !misaligned;
    in_frame <= rst_n && (start || (in_frame && !ends));
  end

  // Whether the word before was the last one, and the CRC's.
  logic was_right;
  always_ff @(posedge clk)
    was_right <= rst_n && loader_state == 3'd6 && loader_taken && loader_last && loader_word == crc;

  // Whether the loader has a bank open, from the word that opens it to its end.
  logic open;
  always_ff @(posedge clk)
    if (!rst_n) open <= 1'b0;
    else if (begun) open <= 1'b1;
    else if (verified || refused != '0) open <= 1'b0;

  always_comb
    if (reset_done) begin
      assert (selected != 2'b11);
      assert ((selected & ~valid) == '0);
      if (start) assert (valid[selected[1]]);
      if (writes) assert (!in_use[load_bank] && !valid[load_bank] && !selected[load_bank]);
      if (verified) assert (!in_use[load_bank] && !valid[load_bank] && !selected[load_bank]);
      if (verified) assert (was_right);
      if (active) assert (newest_bank == shadow_bank);
      if (was_active && !was_finish) assert (active && oldest_bank == shadow_oldest);
      assert (flight_count != 2'd3);
      assert (full == (flight_count == 2'd2));
      assert (active || oldest != newest);
      assert (!active || full == (oldest != newest));
      assert (!flight_keeps || (selected[shadow_bank] && !was_replaced));
      assert (!flight_kept || in_frame || (flight_keeps && was_whole));
      // What makes the proof inductive: beyond the sizes, the loader is at work on a bank that is open.
      if (loader_state >= 3'd2 && loader_state <= 3'd6) assert (open);
      if (open) assert ((loader_state >= 3'd2 && loader_state <= 3'd6) || verified || refused != '0);
      if (open) assert (!valid[load_bank] && !selected[load_bank]);
      if (loader_state >= 3'd3 && loader_state <= 3'd6) assert (!in_use[load_bank]);
      if (writes || verified) assert (open && !in_use[load_bank]);
    end
endmodule
