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
{% for variable in plane_variables %}
    {{ variable.c_type }} {{ variable.name }};
{% endfor %}
} BallbotPlane;

typedef struct {
    BallbotPlane x; /* forward: gyro S1, motor B */
    BallbotPlane y; /* rightward: gyro S2, motor C */
{% for variable in program_variables %}
    {{ variable.c_type }} {{ variable.name }}{% if variable.length > 1 %}[{{ variable.length }}]{% endif %};
{% endfor %}
} BallbotState;

/* Values of control_mode. */
#define BALLBOT_STOP 0U
#define BALLBOT_CALIBRATION 1U
#define BALLBOT_CONTROL 2U

extern BallbotState ballbot;

#endif
