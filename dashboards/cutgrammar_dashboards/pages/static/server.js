// How all pages talk to their server.

export const RETRY = 1500; // between attempts to reach the server again [ms]

// What went wrong: the status of the answer, 0 where there was none, and a sentence to show.
export class Problem extends Error {
  constructor(status, text) {
    super(text);
    this.status = status;
  }
}

// Asks the server; with a message, the request is one that changes something.
export async function send(path, key, message) {
  const options = { headers: { "X-Session": key }, cache: "no-store" };
  if (message) {
    options.method = "POST";
    options.headers["Content-Type"] = "application/json";
    options.body = JSON.stringify(message);
  }
  let answer;
  try {
    answer = await fetch(path, options);
  } catch {
    throw new Problem(0, "The server does not answer.");
  }
  const content = await answer.json().catch(() => ({}));
  if (!answer.ok) throw new Problem(answer.status, content.problem || `The server refused this (${answer.status}).`);
  return content;
}
