/* SPDX-License-Identifier: Apache-2.0 */
/*
 * A reset of the simulated board: the program ends with exit status 87, and whoever runs the bench
 * starts it again on the same flash. Part of the image, not of the runner.
 */
#include "nsi_main.h"

#define EXIT_REBOOT 87

void sys_arch_reboot(int type)
{
	(void)type;
	nsi_exit(EXIT_REBOOT);
}
