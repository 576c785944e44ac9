/* SPDX-License-Identifier: Apache-2.0 */
/**
 * @file
 * One row of the shadow log, and its text. Pure C11.
 */
#ifndef BV_SHADOW_ROW_H_
#define BV_SHADOW_ROW_H_

#include <stddef.h>
#include <stdint.h>

#ifdef __cplusplus
extern "C" {
#endif

#define SHADOW_HEADER                                                                              \
	"#shadow,t_us_node,ax_mps2,ay_mps2,az_mps2,gx_radps,gy_radps,gz_radps,flags"

/** Length of one cell of the log's grid. */
#define SHADOW_PERIOD_US 10000U

/** Units of struct shadow_row in one m/s^2 and one rad/s. */
#define SHADOW_PER_MPS2  10000
#define SHADOW_PER_RADPS 100000

/** Longest text with its NUL: 7 + 20 of time + 6 numbers of 13 with their commas + 6 + 1. */
#define SHADOW_TEXT_MAX 112U

/** Bits of `flags`. */
enum {
	/** An axis was at the end of its range. */
	SHADOW_CLIPPED = 1,
	/** Counts as the chip gave them: no calibration is in force yet, or it is switched off. */
	SHADOW_UNCORRECTED = 2,
	/** Samples are missing before this row. */
	SHADOW_GAP = 4,
};

struct shadow_row {
	uint64_t t_us;
	/** 1e-4 m/s^2. */
	int32_t accel[3];
	/** 1e-5 rad/s. */
	int32_t gyro[3];
	uint16_t flags;
};

/**
 * Write @p row as one line without its end.
 *
 * @param text SHADOW_TEXT_MAX bytes.
 * @return length of the text without its NUL.
 */
size_t shadow_row_text(const struct shadow_row *row, char *text);

#ifdef __cplusplus
}
#endif

#endif /* BV_SHADOW_ROW_H_ */
