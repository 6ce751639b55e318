"""Calls ``/invert`` (SetBool) nine times at once, then ``/far/sample`` parameters, and prints what comes back."""

import rclpy
from rclpy.parameter import Parameter
from rclpy.parameter_client import AsyncParameterClient
from std_srvs.srv import SetBool


def wait(future):
    rclpy.spin_until_future_complete(node, future, timeout_sec=120)
    return future.result()


rclpy.init()
node = rclpy.create_node("caller")
print("ready", flush=True)
client = node.create_client(SetBool, "/invert")
assert client.wait_for_service(120)
futures = [client.call_async(SetBool.Request(data=bool(number % 3))) for number in range(9)]
print([wait(future).success for future in futures], flush=True)
parameters = AsyncParameterClient(node, "/far/sample")
assert parameters.wait_for_services(120)
changes = [Parameter("gain", value=2.5), Parameter("gain", value=2.6), Parameter("name", value="x")]
for ask in (
    lambda: parameters.list_parameters([], 0),
    lambda: parameters.get_parameters(["gain", "flags", "texts", "raw", "nothing"]),
    lambda: parameters.describe_parameters(["gain", "count", "name"]),
    lambda: parameters.get_parameter_types(["gain", "ints", "nothing"]),
    lambda: parameters.set_parameters(changes),
    lambda: parameters.set_parameters_atomically([Parameter("count", value=4), Parameter("ints", value=[7])]),
    lambda: parameters.get_parameters(["gain", "count", "ints"]),
):
    print(wait(ask()), flush=True)
node.destroy_node()
rclpy.shutdown()
