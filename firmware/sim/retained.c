/* SPDX-License-Identifier: Apache-2.0 */
/*
 * RAM that outlives a reset of the simulated board: the last bytes of its flash, which -flash=FILE
 * keeps from one process to the next. Written without the flash's registers, as RAM is.
 */
#include <stdint.h>

#include "NHW_NVMC.h"

#define FLASH_SIZE_B    (512U * 1024U)
#define RETAINED_SIZE_B 64U

uint8_t *hil_retained(void);

uint8_t *hil_retained(void)
{
	return *(uint8_t **)nrfhw_nmvc_flash_get_base_address(0) + FLASH_SIZE_B - RETAINED_SIZE_B;
}
