/*
 * Devices, timer and display of the ballbot on the brick.
 *
 * {{ stamp }}
 */
#include "kernel.h"
#include "kernel_id.h"
#include "ecrobot_interface.h"

#define BLUETOOTH_PIN "1234"

DeclareCounter(SysTimerCnt);

/* Called by the platform before the tasks start. */
void ecrobot_device_initialize(void)
{
    ecrobot_init_sonar_sensor(NXT_PORT_S3);
    ecrobot_init_bt_slave(BLUETOOTH_PIN);
}

/* Called by the platform when the program ends. */
void ecrobot_device_terminate(void)
{
    ecrobot_set_motor_mode_speed(NXT_PORT_B, 1, 0);
    ecrobot_set_motor_mode_speed(NXT_PORT_C, 1, 0);
    ecrobot_term_sonar_sensor(NXT_PORT_S3);
    ecrobot_term_bt_connection();
}

/* Called by the platform every millisecond: drives the alarms of all tasks. */
void user_1ms_isr_type2(void)
{
    (void)SignalCounter(SysTimerCnt);
}

/* Every {{ periods.task_lcd }} ms: refresh the display. */
TASK(task_lcd)
{
    ecrobot_status_monitor("{{ program_name }}");
    TerminateTask();
}
