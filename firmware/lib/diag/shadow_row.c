/* SPDX-License-Identifier: Apache-2.0 */
#include "shadow_row.h"

#include <string.h>

#define ACCEL_DECIMALS 4U
#define GYRO_DECIMALS  5U
#define DIGITS_MAX     20U

static char *put_text(char *at, const char *text)
{
	const size_t size = strlen(text);

	memcpy(at, text, size);
	return at + size;
}

/* The last @p decimals digits behind a point, at least one before it. */
static char *put_number(char *at, uint64_t number, unsigned int decimals)
{
	char digits[DIGITS_MAX];
	unsigned int count = 0;

	do {
		digits[count++] = (char)('0' + number % 10U);
		number /= 10U;
	} while (number > 0U || count <= decimals);
	while (count > 0U) {
		*at++ = digits[--count];
		if (count == decimals && decimals > 0U) {
			*at++ = '.';
		}
	}
	return at;
}

static char *put_vector(char *at, const int32_t values[3], unsigned int decimals)
{
	for (size_t i = 0; i < 3; i++) {
		*at++ = ',';
		if (values[i] < 0) {
			*at++ = '-';
		}
		at = put_number(at, (uint64_t)(values[i] < 0 ? -(int64_t)values[i] : values[i]),
				decimals);
	}
	return at;
}

size_t shadow_row_text(const struct shadow_row *row, char *text)
{
	char *at = put_text(text, "shadow,");

	at = put_number(at, row->t_us, 0);
	at = put_vector(at, row->accel, ACCEL_DECIMALS);
	at = put_vector(at, row->gyro, GYRO_DECIMALS);
	*at++ = ',';
	at = put_number(at, row->flags, 0);
	*at = '\0';
	return (size_t)(at - text);
}
