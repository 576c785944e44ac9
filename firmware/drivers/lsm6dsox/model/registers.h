/* SPDX-License-Identifier: Apache-2.0 */
/**
 * @file
 * Registers of the LSM6DSOX that the model knows: address, default, and which bits may be written.
 *
 * Written from the datasheet's register map (DS12814, sections 8 and 9) and not from the header of
 * the driver under test, so that a wrong address or bit in one shows against the other.
 */
#ifndef BV_LSM6DSOX_MODEL_REGISTERS_H_
#define BV_LSM6DSOX_MODEL_REGISTERS_H_

#include <stdbool.h>
#include <stdint.h>

enum {
	REG_FUNC_CFG_ACCESS = 0x01,
	REG_PIN_CTRL = 0x02,
	REG_FIFO_CTRL1 = 0x07,
	REG_FIFO_CTRL2 = 0x08,
	REG_FIFO_CTRL3 = 0x09,
	REG_FIFO_CTRL4 = 0x0A,
	REG_COUNTER_BDR_REG1 = 0x0B,
	REG_COUNTER_BDR_REG2 = 0x0C,
	REG_INT1_CTRL = 0x0D,
	REG_INT2_CTRL = 0x0E,
	REG_WHO_AM_I = 0x0F,
	REG_CTRL1_XL = 0x10,
	REG_CTRL2_G = 0x11,
	REG_CTRL3_C = 0x12,
	REG_CTRL4_C = 0x13,
	REG_CTRL5_C = 0x14,
	REG_CTRL6_C = 0x15,
	REG_CTRL7_G = 0x16,
	REG_CTRL8_XL = 0x17,
	REG_CTRL9_XL = 0x18,
	REG_CTRL10_C = 0x19,
	REG_ALL_INT_SRC = 0x1A,
	REG_WAKE_UP_SRC = 0x1B,
	REG_D6D_SRC = 0x1D,
	REG_STATUS_REG = 0x1E,
	REG_OUT_TEMP_L = 0x20,
	REG_OUTX_L_G = 0x22,
	REG_OUTX_L_A = 0x28,
	REG_OUTZ_H_A = 0x2D,
	REG_FIFO_STATUS1 = 0x3A,
	REG_FIFO_STATUS2 = 0x3B,
	REG_TIMESTAMP0 = 0x40,
	REG_TIMESTAMP2 = 0x42,
	REG_TIMESTAMP3 = 0x43,
	REG_TAP_CFG0 = 0x56,
	REG_TAP_CFG2 = 0x58,
	REG_WAKE_UP_THS = 0x5B,
	REG_WAKE_UP_DUR = 0x5C,
	REG_MD1_CFG = 0x5E,
	REG_MD2_CFG = 0x5F,
	REG_I3C_BUS_AVB = 0x62,
	REG_INTERNAL_FREQ_FINE = 0x63,
	REG_FIFO_DATA_OUT_TAG = 0x78,
	REG_FIFO_DATA_OUT_Z_H = 0x7E,
	REG_COUNT = 0x80,
};

struct register_rule {
	uint8_t address;
	const char *name;
	uint8_t reset;
	/** Bits the host may choose; the others must keep their reset value. */
	uint8_t writable;
	/** Of the writable ones, those that switch on what the model does not have. */
	uint8_t unmodelled;
};

/** @return the rule for @p address, or NULL when the host must leave it alone. */
const struct register_rule *register_rule(uint8_t address);

/** @return whether @p address may be read. */
bool register_readable(uint8_t address);

#endif /* BV_LSM6DSOX_MODEL_REGISTERS_H_ */
