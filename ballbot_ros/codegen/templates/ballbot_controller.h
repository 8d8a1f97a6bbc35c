/*
 * Shared data of the ballbot's control program.
 *
 * {{ stamp }}
 */
#ifndef BALLBOT_CONTROLLER_H
#define BALLBOT_CONTROLLER_H

#include "ecrobot_interface.h"

/* One plane; both are alike. Units and meanings are in DATA_DICTIONARY.md. */
typedef struct {
{% for signal in plane_signals %}
    {{ signal.c_type }} {{ signal.name }};
{% endfor %}
} BallbotPlane;

typedef struct {
    BallbotPlane x; /* forward: gyro S1, motor B */
    BallbotPlane y; /* rightward: gyro S2, motor C */
{% for signal in program_signals %}
    {{ signal.c_type }} {{ signal.name }}{% if signal.length > 1 %}[{{ signal.length }}]{% endif %};
{% endfor %}
} BallbotState;

/* Values of control_mode. */
#define BALLBOT_STOP 0U
#define BALLBOT_CALIBRATION 1U
#define BALLBOT_CONTROL 2U

extern BallbotState ballbot;

#endif
