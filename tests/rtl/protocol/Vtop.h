// The model by the name that cocotb's main program has for it.
#include "Vbpn_core.h"
using Vtop = Vbpn_core;
