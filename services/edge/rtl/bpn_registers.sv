// What the host reads and writes: registers.rdl is the map, from which bpn.sv has the offsets.
module bpn_registers (
    input logic clk,
    input logic rst_n,

    input logic write,
    input logic [7:0] write_register,
    input logic [31:0] write_data,
    output logic write_refused,  // a clock later
    input logic read,
    input logic [7:0] read_register,
    output logic read_ready,
    output logic [31:0] read_data,
    output logic read_refused,
    output logic irq,

    // Banks.
    output logic select,
    output logic [1:0] select_banks,
    input logic select_refused,
    input logic [1:0] valid,
    input logic [1:0] selected,
    input logic loading,
    input logic [45:0] bank_sizes,
    input logic [63:0] epochs,
    input logic [63:0] crcs,

    // Frames and their results.
    input logic in_flight,
    input logic [bpn::EVENTS-1:0] events,
    input logic result,  // a frame's outputs are written
    input logic [31:0] result_epoch,
    input logic [22:0] result_sizes,
    input logic [31:0] result_clocks,  // since its first beat
    input logic [31:0] result_tail,  // since its last beat
    input logic output_write,
    input logic [1:0] output_group,
    input logic [16*bpn::ACC_W-1:0] output_sums,

    // Words that the host pushes into the streams.
    output logic pixels_push,
    output logic weights_push,
    output logic [31:0] push_data,
    output logic push_last,
    input logic pixels_full,
    input logic weights_full,

    // The host's view of the memories.
    output logic memory_read,  // until `memory_ready`
    output logic [31:0] memory_address,
    input logic memory_ready,
    input logic [31:0] memory_data
);
  localparam int ACC_W = bpn::ACC_W;

  logic [bpn::EVENTS-1:0] pending, enabled;
  logic [31:0] frames, epoch, clocks, tail;
  logic [22:0] result_of;

  function automatic logic [31:0] sizes(input logic [22:0] of);
    sizes = {5'b0, of[bpn::G_NODES+:11], 1'b0, of[bpn::G_ACTIONS+:7], 3'b0, of[bpn::G_CHANNELS+:5]};
  endfunction

  // Writes: what is asked for in one clock is done, or refused, in the next, in which the data still are there.
  logic to_events, to_interrupt, to_address, to_pixels, to_weights, to_none;
  assign select_banks = write_data[1:0];
  assign push_data = write_data;
  assign push_last = write_register[0];
  assign pixels_push = to_pixels && !pixels_full;
  assign weights_push = to_weights && !weights_full;
  assign write_refused = to_none || select_refused || (to_pixels && pixels_full) || (to_weights && weights_full);

  always_ff @(posedge clk) begin
    {select, to_events, to_interrupt, to_address, to_pixels, to_weights, to_none} <= '0;
    case (write_register)
      bpn::R_SELECT: if (write_data[31:2] == '0) select <= write; else to_none <= write;
      bpn::R_EVENTS: to_events <= write;
      bpn::R_INTERRUPT: to_interrupt <= write;
      bpn::R_READ_ADDRESS: to_address <= write;
      bpn::R_PIXELS, bpn::R_PIXELS_LAST: if (bpn::BYTES == 4) to_pixels <= write; else to_none <= write;
      bpn::R_WEIGHTS, bpn::R_WEIGHTS_LAST: to_weights <= write;
      default: to_none <= write;
    endcase
    if (!rst_n) {select, to_events, to_interrupt, to_address, to_pixels, to_weights, to_none} <= '0;
  end

  always_ff @(posedge clk) begin
    pending <= (pending & ~(to_events ? write_data[bpn::EVENTS-1:0] : '0)) | events;
    irq <= (pending & enabled) != '0;
    if (to_interrupt) enabled <= write_data[bpn::EVENTS-1:0];
    if (memory_read && memory_ready) memory_address <= memory_address + 1'b1;
    if (to_address) memory_address <= write_data;
    if (result) begin
      frames <= frames + 1'b1;
      epoch <= result_epoch;
      result_of <= result_sizes;
      clocks <= result_clocks;
      tail <= result_tail;
    end
    if (!rst_n) begin
      {pending, enabled, irq} <= '0;
      {frames, epoch, result_of, clocks, tail, memory_address} <= '0;
    end
  end

  // Outputs of the newest result; those of the next one are written beside them.
  logic [16*ACC_W-1:0] outputs[8];
  logic [16*ACC_W-1:0] output_word;
  logic [ACC_W-1:0] agreeing;
  logic front;
  always_ff @(posedge clk) begin
    if (output_write) outputs[{!front, output_group}] <= output_sums;
    output_word <= outputs[{front, read_register[5:4]}];
    agreeing <= output_word[read_register[3:0]*ACC_W+:ACC_W];
    if (!rst_n) front <= 1'b0;
    else if (result) front <= !front;
  end

  // Reads take four clocks, the memories' as long as they need.
  logic [2:0] waited;
  logic [31:0] value;
  logic unknown;
  wire to_memory = read_register == bpn::R_READ_DATA;
  wire to_outputs = read_register[7:6] == 2'(bpn::R_OUTPUTS >> 6);
  assign memory_read = read && to_memory && !loading;
  assign read_ready = to_memory ? loading || memory_ready : waited[2];
  assign read_data = to_memory ? memory_data : value;
  assign read_refused = to_memory ? loading : unknown;

  always_ff @(posedge clk) begin
    waited <= read ? {waited[1:0], 1'b1} : '0;
    if (waited[2]) waited <= '0;
    unknown <= 1'b0;
    case (read_register)
      bpn::R_IDENTITY: value <= bpn::IDENTITY;
      bpn::R_BUILD: value <= {8'(bpn::BYTES), 8'(bpn::MAX_CHANNELS), 8'(bpn::MAX_ACTIONS), 7'b0, bpn::CONV1_LANES != bpn::BYTES};
      bpn::R_LIMITS: value <= 32'(bpn::MAX_HIDDEN_UNITS);
      bpn::R_STATUS: value <= {26'b0, in_flight, loading, selected, valid};
      bpn::R_SELECT: value <= {30'b0, selected};
      bpn::R_EVENTS: value <= 32'(pending);
      bpn::R_INTERRUPT: value <= 32'(enabled);
      bpn::R_FRAMES: value <= frames;
      bpn::R_RESULT_EPOCH: value <= epoch;
      bpn::R_RESULT_SIZES: value <= sizes(result_of);
      bpn::R_CLOCKS: value <= clocks;
      bpn::R_TAIL: value <= tail;
      bpn::R_BANK_EPOCH: value <= epochs[31:0];
      bpn::R_BANK_CRC: value <= crcs[31:0];
      bpn::R_BANK_SIZES: value <= sizes(bank_sizes[22:0]);
      bpn::R_BANK_EPOCH + 8'd1: value <= epochs[63:32];
      bpn::R_BANK_CRC + 8'd1: value <= crcs[63:32];
      bpn::R_BANK_SIZES + 8'd1: value <= sizes(bank_sizes[45:23]);
      bpn::R_READ_ADDRESS: value <= memory_address;
      default: begin
        value <= 32'($signed({agreeing, 1'b0})) - 32'(result_of[bpn::G_NODES+:11]);
        unknown <= !to_outputs;
      end
    endcase
  end
endmodule
