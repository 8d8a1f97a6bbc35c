// The connection to the program: state arrives, requests go out.

const RETRY_MS = 1000;

/** Address of the connection, with the token that this tab has. */
function address() {
  return `ws://${location.host}/link?token=${sessionStorage.getItem('token') ?? ''}`;
}

/** Connects again after a loss; reports each received value by its topic. */
export class Link {
  #address = address();
  #handlers = new Map();
  #socket = null;

  /** Call `handle` with each value of a topic; `connected` gets true or false. */
  on(topic, handle) {
    this.#handlers.set(topic, handle);
  }

  connect() {
    const socket = new WebSocket(this.#address);
    socket.onopen = () => this.#report('connected', true);
    socket.onmessage = (event) => {
      for (const [topic, value] of Object.entries(JSON.parse(event.data))) this.#report(topic, value);
    };
    socket.onclose = () => {
      this.#report('connected', false);
      setTimeout(() => this.connect(), RETRY_MS);
    };
    this.#socket = socket;
  }

  #report(topic, value) {
    this.#handlers.get(topic)?.(value);
  }

  /** Send a request, such as `{press: 'pause'}`; it is lost while there is no connection. */
  send(request) {
    if (this.#socket?.readyState === WebSocket.OPEN) this.#socket.send(JSON.stringify(request));
  }
}
