// Written by bpn_edge.fpga.package for a build; registers from registers.rdl.
package bpn;
  // The build.
  localparam int BYTES = 4;
  localparam int CONV1_LANES = 4;
  localparam int MAX_CHANNELS = 16;
  localparam int MAX_HIDDEN_UNITS = 256;
  localparam int MAX_ACTIONS = 64;
  // Geometry.
  localparam int IMAGE = 84;
  localparam int BLOCKS = 21;
  localparam int CONV1_WORDS = 200;
  localparam int CONV3_WEIGHTS = 9;
  localparam int FC1_WEIGHTS = 19;
  // Widths, of counters and sums.
  localparam int PAIRS = 2;
  localparam int BEAT_W = 4;
  localparam int BLOCK_W = 5;
  localparam int ROW_W = 7;
  localparam int TREE = 2;
  localparam int BEAT_SUM_W = 10;
  localparam int ROW_SUM_W = 15;
  localparam int SUM_W = 18;
  localparam int EARLIER_W = 18;
  localparam int TAU_W = 19;
  localparam int GROUP_W = 5;
  localparam int ACTION_GROUP_W = 3;
  localparam int KEPT_W = 4;
  localparam int WEIGHT_W = 10;
  localparam int ACC_W = 11;
  // Fields of what is kept of a network's sizes.
  localparam int G_CHANNELS = 0;
  localparam int G_ACTIONS = 5;
  localparam int G_NODES = 12;
  localparam int G_ACTION_GROUPS = 23;
  localparam int G_NODE_GROUPS = 26;
  localparam int G_STACKED = 31;
  localparam int G_LAST_BEAT = 32;
  localparam int GEOMETRY_W = 36;
  localparam int EVENTS = 7;
  // Identities, and registers by number.
  localparam logic [31:0] IDENTITY = 32'h42500001;
  localparam logic [31:0] SET_IDENTITY = 32'h42570104;
  localparam logic [7:0] R_IDENTITY = 8'h00;
  localparam logic [7:0] R_BUILD = 8'h01;
  localparam logic [7:0] R_LIMITS = 8'h02;
  localparam logic [7:0] R_STATUS = 8'h03;
  localparam logic [7:0] R_SELECT = 8'h04;
  localparam logic [7:0] R_EVENTS = 8'h05;
  localparam logic [7:0] R_INTERRUPT = 8'h06;
  localparam logic [7:0] R_FRAMES = 8'h07;
  localparam logic [7:0] R_RESULT_EPOCH = 8'h08;
  localparam logic [7:0] R_RESULT_SIZES = 8'h09;
  localparam logic [7:0] R_CLOCKS = 8'h0a;
  localparam logic [7:0] R_TAIL = 8'h0b;
  localparam logic [7:0] R_BANK_EPOCH = 8'h0c;
  localparam logic [7:0] R_BANK_CRC = 8'h0e;
  localparam logic [7:0] R_BANK_SIZES = 8'h10;
  localparam logic [7:0] R_READ_ADDRESS = 8'h14;
  localparam logic [7:0] R_READ_DATA = 8'h15;
  localparam logic [7:0] R_PIXELS = 8'h18;
  localparam logic [7:0] R_PIXELS_LAST = 8'h19;
  localparam logic [7:0] R_WEIGHTS = 8'h1a;
  localparam logic [7:0] R_WEIGHTS_LAST = 8'h1b;
  localparam logic [7:0] R_OUTPUTS = 8'h40;
endpackage
