// A gyro driver in C++ with a low pass of its own, which takes the place of ballbot_ros's
// gyro_driver. It is ../../gyro_driver.py in C++.

#include <unistd.h>

#include <cmath>
#include <cstdint>
#include <limits>
#include <memory>
#include <random>
#include <string>
#include <utility>
#include <vector>

#include "diagnostic_msgs/msg/diagnostic_status.hpp"
#include "diagnostic_msgs/msg/key_value.hpp"
#include "rclcpp/rclcpp.hpp"
#include "sensor_msgs/msg/imu.hpp"
#include "std_msgs/msg/header.hpp"

using diagnostic_msgs::msg::DiagnosticStatus;
using diagnostic_msgs::msg::KeyValue;
using sensor_msgs::msg::Imu;
using std_msgs::msg::Header;

namespace
{

constexpr double kOffset = 600.0;  // reading at rest [deg/s]
constexpr double kWeight = 0.5;  // of the newest rate in the filtered one
constexpr double kDegreesPerRadian = 180.0 / M_PI;

// The stamp of a header [ns].
int64_t time_ns(const Header & header)
{
  return header.stamp.sec * int64_t{1'000'000'000} + header.stamp.nanosec;
}

// A rate [rad/s] as whole deg/s with the offset, in rad/s again.
double reading(double rate)
{
  return (kOffset + std::round(rate * kDegreesPerRadian)) / kDegreesPerRadian;
}

std::string host()
{
  char name[256] = {};
  gethostname(name, sizeof(name) - 1);
  return name;
}

// Answers each true rate with the reading of a gyro.
class GyroDriver : public rclcpp::Node
{
public:
  GyroDriver()
  : Node("gyro_driver"), instance_(std::to_string(std::random_device{}()))
  {
    const auto stream = rclcpp::QoS(128);  // reliable and volatile, the defaults
    const auto state = rclcpp::QoS(1).transient_local();
    participants_ = create_publisher<DiagnosticStatus>("participants", state);
    gyro_ = create_publisher<Imu>("gyro", stream);
    roll_calls_ = create_subscription<Header>(
      "plant/roll_call", state, [this](const Header & call) {on_roll_call(call);});
    truths_ = create_subscription<Imu>(
      "plant/imu", stream, [this](const Imu & truth) {on_truth(truth);});
  }

private:
  // Join the run from the initial state if it is new. Announce this node in any case.
  void on_roll_call(const Header & call)
  {
    if (call.frame_id != run_) {
      run_ = call.frame_id;
      start_ns_ = time_ns(call);
      answered_ns_ = 0;
      rate_x_ = rate_y_ = 0.0;
    }
    const std::vector<std::pair<std::string, std::string>> values = {
      {"role", "gyro_driver"},
      {"process", std::to_string(getpid())},
      {"instance", instance_},
      {"run", run_},
      {"implementation", "docs/examples/cpp_gyro_driver"},
      {"parameters sha256", ""},
      {"topics", "gyro"},
      {"answered [ns]", std::to_string(answered_ns_)},
    };
    DiagnosticStatus announcement;
    announcement.name = get_fully_qualified_name();
    announcement.hardware_id = host();
    for (const auto & [key, value] : values) {
      KeyValue pair;
      pair.key = key;
      pair.value = value;
      announcement.values.push_back(pair);
    }
    participants_->publish(announcement);
  }

  // Answer a truth of the run. A repeated truth gets the same answer.
  void on_truth(const Imu & truth)
  {
    const int64_t now_ns = time_ns(truth.header);
    if (now_ns < start_ns_) {
      return;
    }
    if (now_ns != answered_ns_) {  // The filter counts a repeated truth only once.
      rate_x_ += kWeight * (truth.angular_velocity.x - rate_x_);
      rate_y_ += kWeight * (truth.angular_velocity.y - rate_y_);
      answered_ns_ = now_ns;
    }
    Imu sample;
    sample.header = truth.header;
    sample.angular_velocity.x = reading(rate_x_);
    sample.angular_velocity.y = reading(rate_y_);
    gyro_->publish(sample);
  }

  std::string instance_;
  std::string run_;
  int64_t start_ns_ = std::numeric_limits<int64_t>::max();
  int64_t answered_ns_ = 0;
  double rate_x_ = 0.0;
  double rate_y_ = 0.0;
  rclcpp::Publisher<DiagnosticStatus>::SharedPtr participants_;
  rclcpp::Publisher<Imu>::SharedPtr gyro_;
  rclcpp::Subscription<Header>::SharedPtr roll_calls_;
  rclcpp::Subscription<Imu>::SharedPtr truths_;
};

}  // namespace

int main(int argc, char ** argv)
{
  rclcpp::init(argc, argv);
  rclcpp::spin(std::make_shared<GyroDriver>());
  rclcpp::shutdown();
  return 0;
}
